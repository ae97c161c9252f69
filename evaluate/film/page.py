"""HTML page of an episode: film and curves of one or more policies, with a common time cursor.

The page is a single file that works offline.
"""

import io
import json
from base64 import b64encode
from contextlib import closing
from html import escape
from operator import itemgetter
from pathlib import Path
from string import Template
from typing import Any

from evaluate.causes.story import timeline
from evaluate.cells import LabelledPolicy
from evaluate.film.curves import curves, events
from evaluate.film.shooting import EpisodeView, FilmSpec, Progress, RenderOptions
from evaluate.rollouts.run import measure_cell
from quad_env.config import FallRule
from quad_env.files.writing import write_atomically

PAGE_RENDER_OPTIONS = RenderOptions((480, 300), camera=None, rate=20.0)
"""Image size, camera and frame rate of the film on an episode's HTML page."""
QUALITY = 70
"""Quality of the WebP images on an episode's HTML page, 0 … 100."""
LEAD = 1.0
"""Time between the start of the playback on an episode's HTML page and the fall or cause of failure, s."""


def write_page(spec: FilmSpec, path: Path, progress: Progress) -> None:
    """Simulate and film an episode, and write its HTML page.

    Args:
        spec: Episode and policies to film. The film ends shortly after a fall, or after `spec.steps` control steps.
        path: HTML file to write.
        progress: Function that receives the completed fraction of the work, 0 … 1.
    """
    count = len(spec.policies)
    episodes = [
        _episode_json(policy, spec, partial_progress(progress, index, count))
        for index, policy in enumerate(spec.policies)
    ]
    write_atomically(path, render_page(spec.title, episodes).encode())
    progress(1.0)


def partial_progress(progress: Progress, done: int, count: int) -> Progress:
    """Return a progress function for one of several equal parts of a job.

    Args:
        progress: Function that receives the completed fraction of all parts together, 0 … 1.
        done: Number of completed parts.
        count: Number of all parts.

    Returns:
        Function that receives the completed fraction of the next part, 0 … 1.
    """
    return lambda share: progress((done + share) / count)


def render_page(title: str, episodes: list[dict[str, Any]]) -> str:
    """Render the HTML page of one episode, with the film and the curves of each policy.

    Args:
        title: Title of the page.
        episodes: List with a dictionary for each policy: film, curves and events of its episode, from `_episode_json`.

    Returns:
        HTML text.
    """
    failure_times = [
        event["time"] for episode in episodes for event in episode["events"] if event["kind"] in ("cause", "fall")
    ]
    start = max(0.0, min(failure_times, default=0.0) - LEAD)
    values = {"period": PAGE_RENDER_OPTIONS.period, "start": start, "episodes": episodes}
    data = json.dumps(values, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")
    folder = Path(__file__).with_name("html")
    html, css, js = ((folder / f"episode.{kind}").read_text(encoding="utf-8") for kind in ("html", "css", "js"))
    return Template(html).substitute(title=escape(title), css=css, js=js, data=data)


def _episode_json(policy: LabelledPolicy, spec: FilmSpec, progress: Progress) -> dict[str, Any]:
    """Simulate and film the episode for one policy, and return film, curves and events as JSON types.

    Args:
        policy: Policy that controls the robot.
        spec: Episode to film.
        progress: Function that receives the completed fraction of the work, 0 … 1.

    Returns:
        Dictionary that the script of the page reads: key -> JSON value. Examples of keys are `frames` (images),
        `curves` (signals), `events` and `verdict` (outcome of the episode).
    """
    frames = []
    with closing(EpisodeView(policy, spec, PAGE_RENDER_OPTIONS)) as view:
        for step in view:
            if step.number % PAGE_RENDER_OPTIONS.steps_per_frame == 0:
                image = io.BytesIO()
                view.picture().save(image, "webp", quality=QUALITY, method=2)
                frames.append(f"data:image/webp;base64,{b64encode(image.getvalue()).decode()}")
                progress(step.number / spec.steps)
        end = view.step.number
        record = view.recorder.episodes()
    measures = measure_cell(policy.label, spec.scenario, record).measures
    return {
        "label": policy.label,
        "verdict": measures.outcome[0].replace("_", " "),
        "failed": not measures.succeeded[0],
        "dt": record.dt,
        "end": end * record.dt,
        "story": [{"time": round(time, 2), "words": words} for time, words in timeline(record, measures)],
        "events": sorted(events(record, measures, end), key=itemgetter("time")),
        "curves": curves(record, end),
        "legs": [name.upper() for name in record.robot.leg_names],
        "fallen": {"tilt": FallRule.tilt, "height": FallRule().min_trunk_height(record.robot.leg_length)},
        "frames": frames,
    }
