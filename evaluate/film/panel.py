"""One policy's part of a film."""

import numpy as np
from PIL import Image

from evaluate.film import captions
from evaluate.film.frames import Filming
from evaluate.film.scene import GHOST, VELOCITY, Scene
from evaluate.film.take import Look, Take
from evaluate.measures import metrics
from evaluate.measures.outcomes import DIVERGED, FELL, SUCCEEDED, SUCCESS_RULE
from evaluate.measures.tracking import SETTLING_TIME
from evaluate.rollouts.experiment import LabelledPolicy
from evaluate.rollouts.rollout import Recorder, watch

AFTERMATH = 1.0
"""s that are shown after a fall."""
ALARM, GOOD, BAD = (200, 30, 30), (0, 130, 90), (190, 110, 0)


class Panel:
    """An episode of one policy, step by step, with what is drawn of it; close it in the end.

    Raises:
        ValueError: the policy is for another robot.
    """

    def __init__(self, policy: LabelledPolicy, take: Take, look: Look) -> None:
        self._label, self._look = policy.label, look
        self._filming = Filming(look.size, look.camera)
        self._recorder = Recorder(policy.policy, np.array([take.seed]), take.steps)
        self._steps = watch(
            policy.policy,
            take.scenario,
            take.seed,
            steps=take.steps,
            command=take.command,
            hardware=take.hardware,
        )
        self.step = next(self._steps)
        """The control step that the episode is at."""
        self._recorder(self.step)
        self._scene = Scene(self.step)
        self._has_outcome = take.steps > round(SETTLING_TIME / self.step.env.dt)

    def advance(self) -> None:
        """Simulate a control step; a robot whose simulation has diverged stays as it is."""
        step = next(self._steps, None)
        if step is not None:
            self.step = step
            self._recorder(step)
            self._scene.advance(step)

    @property
    def over(self) -> bool:
        """Whether nothing more is to be seen."""
        falls = self._recorder.falls
        past = self.step.number - (falls.step[0] + 1)
        return bool(falls.fell[0] and (self.step.infos["diverged"][0] or past >= round(AFTERMATH / self.step.env.dt)))

    def draw(self, last: bool) -> Image.Image:
        """The robot now, with its captions; at last with its outcome."""
        marks = self._scene.marks() if self._look.ghost else ()
        image = Image.fromarray(self._filming.draw(self.step.env, marks))
        text = captions.Text(self._look.letters, edge=1)
        text.write(image, self._label, 0)
        if self._look.ghost:
            text.write(image, captions.motion(self._scene.velocity), 1, captions.ink(VELOCITY))
            text.write(image, f"{self._scene.way_to_ghost:.2f} m from its ghost", 2, captions.ink(GHOST))
        words, ground = self._news(last)
        if words:
            text.sign(image, words, ground)
        return image

    def _news(self, last: bool) -> tuple[str, captions.Ink]:
        """What there is to say of the episode."""
        falls, dt = self._recorder.falls, self.step.env.dt
        outcome = self._outcome() if last else None
        if falls.fell[0]:
            fell = f"fell at {(falls.step[0] + 1) * dt:.2f} s: {falls.reason[0]}"
            return fell if outcome in (None, FELL, DIVERGED) else f"{outcome}, {fell}", ALARM
        if outcome is not None:
            return f"{outcome.replace('_', ' ')} ({SUCCESS_RULE})", GOOD if outcome == SUCCEEDED else BAD
        return ("pushed" if self._scene.pushed else ""), ALARM

    def _outcome(self) -> str | None:
        """By the rule that evaluations run under; None of an episode that is too short."""
        return str(metrics.outcome(self._recorder.episodes())[0]) if self._has_outcome else None

    def close(self) -> None:
        """End the episode and free the renderer."""
        self._steps.close()
        self._filming.close()
