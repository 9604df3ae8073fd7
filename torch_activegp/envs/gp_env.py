"""The GP as an environment to plan in: its reward is the acquisition function."""

from __future__ import annotations

from typing import cast

import torch
from tensordict import TensorDict, TensorDictBase
from tensordict.nn import TensorDictModuleBase
from tensordict.utils import NestedKey
from torch import Tensor
from torchrl.data import Bounded, Composite, Unbounded
from torchrl.envs import ModelBasedEnvBase

from torch_activegp import keys
from torch_activegp.envs.start_state import given_state
from torch_activegp.envs.transitions import MeanTransition, Transition
from torch_activegp.errors import ConfigurationError, ShapeError
from torch_activegp.means import EpisodicMean
from torch_activegp.models import DynamicsGP
from torch_activegp.models.cached_posterior import CachedPosterior, Features
from torch_activegp.models.posterior_module import posterior_quantities
from torch_activegp.simulators import ActionSpace, StateSpace


class GPEnv(ModelBasedEnvBase):
    """A TorchRL model-based environment that steps with the posterior and pays the acquisition function.

    It accepts any batch shape. The acquisition function sees its own keys (:mod:`torch_activegp.keys`): the present
    state and action, and the posterior there, never the new state under the same name. Planners that know
    :meth:`imagine` skip ``rollout``: the trajectories follow the mean, and everything that only the score needs, the
    variance above all, is then computed for all steps in one product.

    Args:
        gp: the model; its state space must have a name and bounds for each state.
        score: acquisition function, a TensorDict module whose last ``out_key`` is the reward ``(..., 1)``.
        action_space: default that of the simulator in the GP's mean.
        transition: how an imagined step moves; default :class:`MeanTransition`. One with extra actions has them
            appended to the controls in the planned action.
        action_key: where the planned action ``(..., m + e)`` stands.
        clip: keep imagined states within the bounds of the state space, where it has some.
        seed: of :meth:`reset`, which draws states within the bounds.

    Raises:
        ConfigurationError: there is no state space or no action space, or the score reads what no posterior has.

    Example:
        >>> import gpytorch
        >>> from torch_activegp.acquisition import Spread
        >>> from torch_activegp.means import SimulatorMean
        >>> from torch_activegp.simulators import Pendulum
        >>> env = GPEnv(DynamicsGP(SimulatorMean(Pendulum()), gpytorch.kernels.RBFKernel()), Spread())
        >>> env.rollout(3)["next", "reward"].shape
        torch.Size([3, 1])
    """

    _supports_set_state = True

    def __init__(
        self,
        gp: DynamicsGP,
        score: TensorDictModuleBase,
        *,
        action_space: ActionSpace | None = None,
        transition: Transition | None = None,
        action_key: NestedKey = keys.ACTION,
        clip: bool = True,
        seed: int = 0,
    ) -> None:
        action_space = action_space or _action_space_of(gp)
        if gp.state_space is None:
            raise ConfigurationError("GPEnv: the GP has no state space. Pass DynamicsGP(..., state_space=...).")
        transition = transition or MeanTransition()
        model = _Imagination(gp, score, action_space, transition, action_key, clip)
        device = gp.output_scale.device
        super().__init__(model, device=device)
        dtype, count = gp.output_scale.dtype, transition.num_extra_actions(gp.num_outputs)
        state = Unbounded((gp.num_outputs,), dtype=dtype, device=device)
        ones = torch.ones(count, dtype=dtype, device=device)
        low, high = torch.cat([action_space.low.to(ones), -ones]), torch.cat([action_space.high.to(ones), ones])
        self.observation_spec = Composite({keys.STATE: state}, device=device)
        self.state_spec = Composite({keys.STATE: state.clone()}, device=device)
        action = Composite(device=device)
        action.set(action_key, Bounded(low, high, dtype=dtype, device=device))
        self.full_action_spec = action
        self.reward_spec = Unbounded((1,), dtype=dtype, device=device)
        self.generator = torch.Generator().manual_seed(seed)

    @property
    def gp(self) -> DynamicsGP:
        """The model that is planned in."""
        return self.world_model.gp

    def imagine(self, tensordict: TensorDictBase, actions: Tensor) -> Tensor:
        """Score many action sequences at once, without ``rollout``.

        Args:
            tensordict: start states ``(*B, d)`` under ``"state"``.
            actions: ``(*B, C, H, m + e)``, C candidates over a horizon H.

        Returns:
            The reward of each step, ``(*B, C, H)``.

        Raises:
            ShapeError: the shapes do not fit.
        """
        state, d = tensordict.get(keys.STATE), self.gp.num_outputs
        planned = self.full_action_spec[self.action_key].shape[-1]
        if actions.dim() < 3 or actions.shape[-1] != planned or state.shape != (*actions.shape[:-3], d):
            raise ShapeError(
                f"imagine: wanted states (*B, {d}) and actions (*B, C, H, {planned}), found {tuple(state.shape)} and "
                f"{tuple(actions.shape)}."
            )
        return self.world_model.imagine(state, actions)

    def _reset(
        self, tensordict: TensorDictBase | None = None, set_state: bool | None = None, **kwargs: object
    ) -> TensorDictBase:
        shape = self.batch_size if tensordict is None else tensordict.shape
        if set_state:
            state = given_state(tensordict, self.gp.output_scale, self.gp.num_outputs)
        else:
            state = self.world_model.state_space.sample(shape, self.generator).to(self.gp.output_scale)
        return TensorDict({keys.STATE: state}, batch_size=shape, device=self.device)

    def _set_seed(self, seed: int | None) -> None:
        if seed is not None:
            self.generator.manual_seed(seed)

    def get_extra_state(self) -> Tensor:
        """The generator's state, so that a resumed run draws the same resets."""
        return self.generator.get_state()

    def set_extra_state(self, state: Tensor) -> None:
        """Restore the generator."""
        self.generator.set_state(state.cpu())


class _Imagination(TensorDictModuleBase):
    """One imagined step as a TensorDict module, and many as plain tensor operations."""

    def __init__(
        self,
        gp: DynamicsGP,
        score: TensorDictModuleBase,
        action_space: ActionSpace,
        transition: Transition,
        action_key: NestedKey,
        clip: bool,
    ) -> None:
        super().__init__()
        self.gp = gp
        self.score = score
        self.action_space = action_space
        self.transition = transition
        self.action_key = action_key
        self.clip = clip and bool(torch.isfinite(torch.stack([self.state_space.low, self.state_space.high])).any())
        self.in_keys = [keys.STATE, action_key]
        self.out_keys = [keys.STATE, keys.REWARD]
        known = (keys.STATE, keys.ACTION, *keys.POSTERIOR_KEYS)
        unknown = [key for key in score.in_keys if key not in known]
        if unknown:
            raise ConfigurationError(
                f"GPEnv: wanted a score that reads some of {known}, found {unknown}. Give the score's parts in_keys of "
                "these names, or compute the rest inside the score."
            )

    @property
    def state_space(self) -> StateSpace:
        """The GP's; :class:`GPEnv` has made sure that there is one."""
        return cast(StateSpace, self.gp.state_space)

    @property
    def wanted(self) -> list[str]:
        """The posterior quantities that the score reads."""
        read = self.score.in_keys
        return [key for key in keys.POSTERIOR_KEYS if key in read]

    def forward(self, tensordict: TensorDictBase) -> TensorDictBase:
        """One step from ``"state"`` and the planned action to the next state and the reward."""
        state, planned = tensordict.get(keys.STATE), tensordict.get(self.action_key)
        controls, extra = self._split(planned.reshape(-1, planned.shape[-1]))
        z = torch.cat([state.reshape(-1, state.shape[-1]), controls], dim=-1).to(self.gp.output_scale)
        posterior = self.gp.posterior
        names = dict.fromkeys([*self.transition.needs, *self.wanted])
        quantities = posterior_quantities(posterior, posterior.features(z), list(names))
        tensordict.set(keys.STATE, self._move(self.state_space, quantities, extra).reshape(state.shape))
        return tensordict.set(keys.REWARD, self._value(z, quantities).reshape(*state.shape[:-1], 1))

    def imagine(self, state: Tensor, actions: Tensor) -> Tensor:
        """See :meth:`GPEnv.imagine`."""
        posterior = self.gp.posterior  # it outlives this call, so it is not made in inference mode
        with torch.inference_mode():
            value = self._imagine(posterior, state, actions)
        return value.clone()  # an ordinary tensor, which may take part in anything

    def _imagine(self, posterior: CachedPosterior, state: Tensor, actions: Tensor) -> Tensor:
        *batch, candidates, horizon, _ = actions.shape
        d, space = state.shape[-1], self.state_space
        controls, extra = self._split(actions.flatten(0, -3).transpose(0, 1))
        count = controls.shape[1]
        # One piece of memory for all points and one for their kernel values: nothing is copied between the steps.
        z = posterior.output_scale.new_empty(horizon, count, d + controls.shape[-1])
        z[..., d:] = controls
        states = z[..., :d].unbind()
        states[0].unflatten(0, (*batch, candidates)).copy_(state.unsqueeze(-2))
        cross = z.new_empty(posterior.num_kernels, horizon, count, posterior.num_points)
        steps, moved_by = [], []
        for t, (point, memory) in enumerate(zip(z.unbind(), cross.unbind(1), strict=True)):
            steps.append(posterior.features(point, out=memory))
            moved_by.append(posterior_quantities(posterior, steps[t], self.transition.needs))
            if t + 1 < horizon:
                self._move(space, moved_by[t], extra[t], out=states[t + 1])
        visited = z.flatten(0, 1)
        features = Features.join(steps, visited, cross.flatten(1, 2))
        quantities = {name: torch.cat([part[name] for part in moved_by]) for name in self.transition.needs}
        late = [name for name in self.wanted if name not in quantities]
        value = self._value(visited, quantities | posterior_quantities(posterior, features, late))
        return value.reshape(horizon, *batch, candidates).movedim(0, -1)

    def _split(self, planned: Tensor) -> tuple[Tensor, Tensor]:
        m = self.action_space.dim
        return planned[..., :m], planned[..., m:]

    def _move(
        self, space: StateSpace, quantities: dict[str, Tensor], extra: Tensor, out: Tensor | None = None
    ) -> Tensor:
        following = space.wrap(self.transition.next_state(quantities, extra))
        if self.clip:
            return torch.clamp(following, space.low, space.high, out=out)
        return following if out is None else out.copy_(following)

    def _value(self, z: Tensor, quantities: dict[str, Tensor]) -> Tensor:
        d, score = self.gp.num_outputs, self.score
        visited = {keys.STATE: z[:, :d], keys.ACTION: z[:, d:]}
        return score(TensorDict(visited | quantities, z.shape[:1], device=z.device)).get(score.out_keys[-1])


def _action_space_of(gp: DynamicsGP) -> ActionSpace:
    mean = gp.mean_module.base_mean if isinstance(gp.mean_module, EpisodicMean) else gp.mean_module
    simulator = getattr(mean, "simulator", None)
    if simulator is None:
        raise ConfigurationError("GPEnv: the GP's mean wraps no simulator, so pass action_space=ActionSpace(...).")
    return simulator.action_space
