"""A MuJoCo model as a simulator: batched over all cores, with angles, quaternions and bounds read from the model."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
import torch
from torch import Tensor

from torch_activegp.errors import ConfigurationError, SimulationError
from torch_activegp.simulators.base import Simulator, broadcast_batch
from torch_activegp.simulators.mujoco_batch import Array, BatchRunner
from torch_activegp.simulators.mujoco_layout import Bounds, action_space, state_space
from torch_activegp.simulators.mujoco_model import ModelSource, load_model


class MujocoSimulator(Simulator):
    """Steps an MJCF model; state (qpos, qvel, act), action (ctrl) or (ctrl, qfrc_applied), in MuJoCo's units (SI).

    Names of the dimensions are ``qpos.<joint>``, ``qvel.<joint>``, ``act.<actuator>`` for actuators with dynamics,
    ``ctrl.<actuator>`` and ``qfrc.<joint>``. Each call computes in float64 on the CPU, on all cores, and returns the
    dtype and device of the state. The solver's warm start is zero at the start of each call, so equal inputs give equal
    bits. A sample that MuJoCo finds unstable, or whose input is not finite, returns as NaN and leaves the others alone.

    What the state cannot hold (delayed controls, plastic deformation, warm start) lives through one ``rollout``, but
    starts anew at each ``step``: for a model with delayed actuators use ``rollout``. Otherwise both agree to the
    tolerance of MuJoCo's constraint solver.

    There are no gradients through MuJoCo.

    Args:
        source: path of an MJCF file, MJCF text, ``MjSpec`` or ``MjModel``.
        frame_skip: time steps of the model for each action; ``dt`` is timestep x frame_skip.
        angles: names of the hinge joints that live on a circle. Default: each hinge without a limit whose number of
            turns has no influence, so without a spring, a position servo, a fixed tendon or a coupling to a joint.
        state_bounds: bounds in place of the model's, ``{name: (low, high)}``; a name's start before a dot stands for
            all such dimensions, for example ``{"qvel": (-20.0, 20.0)}``.
        action_bounds: like ``state_bounds``, for example ``{"qfrc": (-1.0, 1.0)}``.
        external_force: append nv generalised forces, N or N m, to the action.
        nthread: number of threads; None for all cores.

    Raises:
        ConfigurationError: no such file, a model that does not compile, or arguments that do not fit it.

    Example:
        >>> rod = "<body><joint name='hip' axis='0 1 0'/><geom size='.05' fromto='0 0 0 0 0 -1' type='capsule'/></body>"
        >>> simulator = MujocoSimulator(f"<mujoco><worldbody>{rod}</worldbody></mujoco>", external_force=True)
        >>> simulator.state_space.names, simulator.action_space.names, simulator.dt
        (('qpos.hip', 'qvel.hip'), ('qfrc.hip',), 0.002)
        >>> simulator(torch.tensor([[0.1, 0.0]]), torch.tensor([[0.0]])).shape
        torch.Size([1, 2])
    """

    def __init__(
        self,
        source: ModelSource,
        *,
        frame_skip: int = 1,
        angles: Sequence[str] | None = None,
        state_bounds: Bounds | None = None,
        action_bounds: Bounds | None = None,
        external_force: bool = False,
        nthread: int | None = None,
    ) -> None:
        for name, value in (("frame_skip", frame_skip), ("nthread", 1 if nthread is None else nthread)):
            if value < 1:
                raise ConfigurationError(f"MujocoSimulator: wanted `{name}` >= 1, found {value}.")
        model = load_model(source)
        super().__init__(
            state_space(model, angles, state_bounds),
            action_space(model, external_force, action_bounds),
            dt=model.opt.timestep * frame_skip,
        )
        self.frame_skip = int(frame_skip)
        self._runner = BatchRunner(model, nthread, external_force)

    @property
    def model(self) -> mujoco.MjModel:
        """The compiled model, to read. To change it, edit an ``MjSpec`` and make another simulator."""
        return self._runner.model

    @property
    def default_state(self) -> Tensor:
        """The state after ``mj_resetData``: qpos0, no velocity, default activations; ``(d,)``, float64."""
        data = mujoco.MjData(self.model)
        return torch.from_numpy(np.concatenate([data.qpos, data.qvel, data.act]))

    def step(self, state: Tensor, action: Tensor) -> Tensor:
        """Advances states ``(..., d)`` by ``frame_skip`` time steps under actions ``(..., m)``; see `Simulator.step`.

        Raises:
            SimulationError: an input requires a gradient.
        """
        self._refuse_gradients(state, action)
        batch = broadcast_batch(state.shape[:-1], action.shape[:-1])
        after = self._runner.step(
            _rows(state.expand(*batch, -1), 1), _rows(action.expand(*batch, -1), 1), self.frame_skip
        )
        return self._wrapped(after, state, batch)

    def rollout(self, state: Tensor, actions: Tensor) -> Tensor:
        """Applies a sequence of actions in one native call.

        Args:
            state: initial states, ``(..., d)``.
            actions: ``(..., T, m)``, each held for ``dt``.

        Returns:
            The states after each action, ``(..., T, d)``; NaN from the step on at which a sample diverged.

        Raises:
            ShapeError: the shapes do not fit; see `Simulator.rollout`.
            SimulationError: an input requires a gradient.
        """
        batch = self._check_rollout(state, actions)
        self._refuse_gradients(state, actions)
        length = actions.shape[-2]
        after = self._runner.rollout(
            _rows(state.expand(*batch, -1), 1), _rows(actions.expand(*batch, -1, -1), 2), self.frame_skip
        )
        return self._wrapped(after, state, torch.Size((*batch, length)))

    def extra_repr(self) -> str:
        """Time step and model name, for ``print``."""
        return f"dt={self.dt}, frame_skip={self.frame_skip}, nthread={self._runner.nthread or 'all'}"

    def _wrapped(self, after: Array, like: Tensor, batch: torch.Size) -> Tensor:
        states = torch.from_numpy(after).reshape(*batch, self.state_dim)
        wrapped = self.state_space.wrap(states.to(self.state_space.low.device))
        return wrapped.to(like)

    @staticmethod
    def _refuse_gradients(state: Tensor, action: Tensor) -> None:
        if torch.is_grad_enabled() and (state.requires_grad or action.requires_grad):
            raise SimulationError(
                "MujocoSimulator: an input requires a gradient, and MuJoCo gives none. Call it under `torch.no_grad()` "
                "or with `.detach()`-ed inputs, or use a simulator written in torch."
            )


def _rows(tensor: Tensor, event_dims: int) -> Array:
    batch, event = tensor.shape[: tensor.dim() - event_dims], tensor.shape[tensor.dim() - event_dims :]
    flat = tensor.detach().to(device="cpu", dtype=torch.float64)
    return flat.reshape(batch.numel(), *event).numpy()  # -1 would be ambiguous where an event has no elements
