"""An evaluation set that was written without sight of the tool: fourteen machines, own equations of motion."""
