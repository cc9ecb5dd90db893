"""Many environments at once, one process each; one that crashes takes nothing from the others."""

import multiprocessing
import traceback
from collections.abc import Callable, Sequence
from functools import partial
from multiprocessing.connection import Connection
from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space, concatenate, create_empty_array

from fusionnet.errors import FusionNetError, InputError
from fusionnet.randomness import derived_seed
from fusionnet.simulation.environment import PickPlace
from fusionnet.simulation.servo_environment import PickPlaceServo

Reply = tuple[Any, ...]


class PickPlaceVector(VectorEnv[Any, Any, Any]):
    """Several `PickPlace` environments, one process each, stepped together.

    Worker i with seed s begins as a single environment with seed s + i does. A worker that
    crashes, or refuses its action, is reported in `info["error"][i]`: its reward is 0, it is
    truncated, and its observation is empty (zeros); the others' results are kept. It begins
    anew with the next step, as every environment does that has ended; a dead process is
    started again, and draws from a seed that follows from its last.

    The processes are spawned, as OpenGL does not survive a fork: a script makes this below
    `if __name__ == "__main__":`.

    Args:
        num_envs: How many.
        environment: What each worker makes.
        options: Of the environment.

    Raises:
        InputError: If `num_envs` is not positive, or the options are refused.
    """

    metadata = {"render_modes": [], "autoreset_mode": AutoresetMode.NEXT_STEP}

    def __init__(
        self,
        num_envs: int = 2,
        environment: Callable[..., PickPlace] = PickPlace,
        **options: Any,
    ) -> None:
        if num_envs < 1:
            raise InputError(f"{num_envs} environments cannot be made; give 1 or more.")
        self._make = partial(environment, **options)
        single = self._make()
        self.num_envs = num_envs
        self.single_observation_space = single.observation_space
        self.single_action_space = single.action_space
        self.observation_space = batch_space(single.observation_space, num_envs)
        self.action_space = batch_space(single.action_space, num_envs)
        single.close()
        assert isinstance(single.observation_space, spaces.Dict)
        self._blank = {
            name: np.zeros_like(space.low) if isinstance(space, spaces.Box) else ""
            for name, space in single.observation_space.spaces.items()
        }
        self._ended = np.zeros(num_envs, dtype=bool)
        self.workers = [_Worker(self._make) for _ in range(num_envs)]

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Any, dict[str, Any]]:
        """Begin everywhere; worker i with seed + i, or its own of a list of seeds.

        Raises:
            InputError: If there is not one seed an environment.
        """
        seeds: Sequence[int | None]
        if seed is None or isinstance(seed, int | np.integer):
            seeds = [None if seed is None else int(seed) + i for i in range(self.num_envs)]
        else:
            seeds = seed
        self._check_count(len(seeds), "seeds")
        for worker, own in zip(self.workers, seeds, strict=True):
            worker.ask("reset", seed=own, options=options)
        observations, _, _, _, infos = self._answers(np.ones(self.num_envs, dtype=bool))
        return observations, infos

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """One step everywhere; environments that have ended begin anew and ignore their action.

        Raises:
            InputError: If there is not one action an environment.
        """
        begins = self._ended.copy()
        chosen = [np.asarray(action) for action in actions]
        self._check_count(len(chosen), "actions")
        for worker, action, begin in zip(self.workers, chosen, begins, strict=True):
            if begin:
                worker.ask("reset")
            else:
                worker.ask("step", action)
        return self._answers(begins)

    def close_extras(self, **_: Any) -> None:
        """End all processes."""
        for worker in self.workers:
            worker.end()

    def _check_count(self, count: int, what: str) -> None:
        """Refuse a wrong number before any worker is asked: each must be asked and answer once."""
        if count != self.num_envs:
            raise InputError(
                f"{count} {what} were given for {self.num_envs} environments; give one for each."
            )

    def _answers(self, begins: np.ndarray) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        observations = []
        infos: dict[str, Any] = {}
        rewards = np.zeros(self.num_envs)
        terminated, truncated = np.zeros((2, self.num_envs), dtype=bool)
        for index, worker in enumerate(self.workers):
            status, *answer = worker.answer()
            if status == "error":
                observation, info = self._blank, {"error": answer[0]}
                truncated[index] = True
            elif begins[index]:
                observation, info = answer
            else:
                observation, rewards[index], terminated[index], truncated[index], info = answer
            observations.append(observation)
            infos = self._add_info(infos, info, index)
        self._ended = terminated | truncated
        space = self.single_observation_space
        batch: Any = create_empty_array(space, n=self.num_envs, fn=np.zeros)
        return concatenate(space, observations, batch), rewards, terminated, truncated, infos


class PickPlaceServoVector(PickPlaceVector):
    """Several `PickPlaceServo` environments, one process each; see `PickPlaceVector`."""

    def __init__(self, num_envs: int = 2, **options: Any) -> None:
        super().__init__(num_envs, PickPlaceServo, **options)


class _Worker:
    """One process with one environment; started when it is first asked, and again if it died.

    An environment that replaces one that died is seeded from the last seed that was given.
    """

    def __init__(self, make: Callable[[], Any]) -> None:
        self._make = make
        self._process: Any = None
        self._pipe: Connection | None = None
        self._lost = ""
        self._seed: int | None = None
        self._replaced = False
        self._replacements = 0

    @property
    def pid(self) -> int | None:
        return None if self._process is None else self._process.pid

    def ask(self, method: str, *words: Any, **named: Any) -> None:
        self._lost = ""
        if method == "reset":
            named["seed"] = self._next_seed(named.get("seed"))
        if self._process is None:
            context = multiprocessing.get_context("spawn")  # OpenGL does not survive a fork
            self._pipe, theirs = context.Pipe()
            self._process = context.Process(target=_work, args=(theirs, self._make), daemon=True)
            self._process.start()
            theirs.close()
        assert self._pipe is not None
        try:
            self._pipe.send((method, words, named))
        except OSError:
            self._lost = self._bury()

    def answer(self) -> Reply:
        if self._lost:
            return "error", self._lost
        assert self._pipe is not None
        try:
            reply: Reply = self._pipe.recv()
        except (EOFError, OSError):
            return "error", self._bury()
        if reply[0] == "broken":
            self._replaced = True
            return "error", *reply[1:]
        return reply

    def end(self) -> None:
        if self._process is None:
            return
        try:
            assert self._pipe is not None
            self._pipe.send(("close", (), {}))
        except OSError:
            pass
        self._process.join(5.0)
        self._bury()

    def _next_seed(self, given: int | None) -> int | None:
        """What a reset is seeded with: as given, or new if the environment replaces another."""
        replaced, self._replaced = self._replaced, False
        if given is not None:
            self._seed, self._replacements = int(given), 0
        elif replaced and self._seed is not None:
            self._replacements += 1
            return derived_seed(self._seed, "replacement", self._replacements)
        return given

    def _bury(self) -> str:
        """Give the process up; a sentence that says how it ended."""
        process, self._process = self._process, None
        self._replaced = True
        process.join(1.0)
        if process.is_alive():
            process.kill()
            process.join()
        if self._pipe is not None:
            self._pipe.close()
        code = process.exitcode
        how = f"signal {-code}" if code is not None and code < 0 else f"exit status {code}"
        return f"The process of this environment ended ({how}); it begins anew with the next step."


def _work(pipe: Connection, make: Callable[[], Any]) -> None:
    """What a worker's process does until it is told to close."""
    environment = None
    while True:
        try:
            method, words, named = pipe.recv()
        except EOFError:
            return
        if method == "close":
            return
        try:
            environment = environment or make()
            pipe.send(("ok", *getattr(environment, method)(*words, **named)))
        except FusionNetError as error:
            pipe.send(("error", str(error)))
        except Exception:
            pipe.send(("broken", traceback.format_exc()))
            environment = None
