"""Page of an episode: film and curves under one cursor, for one or more policies, in one offline file."""

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
"""Size and rate of the film on a page."""
QUALITY = 70
"""Quality of the WebP images, out of 100."""
LEAD = 1.0
"""s. Time before the first cause or fall at which the page opens."""


def write_page(spec: FilmSpec, path: Path, progress: Progress) -> None:
    """Simulate, film and write the page of an episode.

    Args:
        spec: Episode to film; the film ends as `render_frames` does.
        path: File to write.
        progress: Receives the completed part, 0 … 1.
    """
    count = len(spec.policies)
    episodes = [
        _episode_json(policy, spec, partial_progress(progress, index, count))
        for index, policy in enumerate(spec.policies)
    ]
    write_atomically(path, render_page(spec.title, episodes).encode())
    progress(1.0)


def partial_progress(progress: Progress, done: int, count: int) -> Progress:
    """Return the progress of one of several equal parts.

    Args:
        progress: Receives the completed part of the whole.
        done: Number of completed parts.
        count: Number of parts.

    Returns:
        Receives the completed part, 0 … 1, of the next one.
    """
    return lambda share: progress((done + share) / count)


def render_page(title: str, episodes: list[dict[str, Any]]) -> str:
    """Render the page of the same episode of several policies.

    Args:
        title: Title of the page.
        episodes: Content of each policy's episode, from `_episode_json`.

    Returns:
        HTML.
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
    """Simulate and film one policy's episode; return the content of the page as JSON values."""
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
