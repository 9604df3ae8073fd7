"""The TensorDict keys through which models, acquisition functions, environments and planners meet.

===============  ==================================================  ======================
key              meaning                                             symbol in the paper
===============  ==================================================  ======================
STATE            state, ``(..., d)``                                 x
ACTION           action, ``(..., m)``                                u
LOC              posterior mean of the next state, ``(..., d)``      mu_{tau,n}(x, u)
SCALE            posterior standard deviation, ``(..., d)``          sigma_{tau,n}(x, u)
PRIOR_LOC        mean at the start of the episode, ``(..., d)``      m_tau(x, u)
SIMULATOR_LOC    the simulator's next state, ``(..., d)``            p_0(x, u)
NOISE_SCALE      standard deviation of the noise, ``(..., d)``       sigma
SIGNAL_SCALE     prior standard deviation of f - m, ``(..., d)``     1 in the paper
SCORE            acquisition value, ``(..., 1)``                     A(u; x)
REWARD           what a planner maximises, ``(..., 1)``
===============  ==================================================  ======================

Reference: Miller, Thorpe, Topcu, *Active Learning of Dynamics Using Prior Domain Knowledge in the Sampling
Process*, arXiv 2403.17233.
"""

from __future__ import annotations

STATE = "state"
ACTION = "action"
LOC = "loc"
SCALE = "scale"
PRIOR_LOC = "prior_loc"
SIMULATOR_LOC = "simulator_loc"
NOISE_SCALE = "noise_scale"
SIGNAL_SCALE = "signal_scale"
SCORE = "score"
REWARD = "reward"

POSTERIOR_KEYS = (LOC, SCALE, PRIOR_LOC, SIMULATOR_LOC, NOISE_SCALE, SIGNAL_SCALE)
"""The keys that a GP's posterior can fill."""
