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


def write_page(take: FilmSpec, path: Path, progress: Progress) -> None:
    """Simulate, film and write the page of an episode.

    Args:
        spec: Episode to film; the film ends as `render_frames` does.
        path: File to write.
        progress: Receives the completed part, 0 … 1.
    """
    count = len(take.policies)
    shown = [
        _episode_json(policy, take, partial_progress(progress, place, count))
        for place, policy in enumerate(take.policies)
    ]
    write_atomically(path, render_page(take.title, shown).encode())
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
    failures = [event["time"] for each in episodes for event in each["events"] if event["kind"] in ("cause", "fall")]
    values = {
        "period": PAGE_RENDER_OPTIONS.period,
        "start": max(0.0, min(failures, default=0.0) - LEAD),
        "episodes": episodes,
    }
    data = json.dumps(values, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")
    folder = Path(__file__).with_name("html")
    html, css, js = ((folder / f"episode.{kind}").read_text(encoding="utf-8") for kind in ("html", "css", "js"))
    return Template(html).substitute(title=escape(title), css=css, js=js, data=data)


def _episode_json(policy: LabelledPolicy, take: FilmSpec, progress: Progress) -> dict[str, Any]:
    """Simulate and film one policy's episode; return the content of the page as JSON values."""
    frames = []
    with closing(EpisodeView(policy, take, PAGE_RENDER_OPTIONS)) as panel:
        for step in panel:
            if step.number % PAGE_RENDER_OPTIONS.steps_per_frame == 0:
                panel.picture().save(image := io.BytesIO(), "webp", quality=QUALITY, method=2)
                frames.append(f"data:image/webp;base64,{b64encode(image.getvalue()).decode()}")
                progress(step.number / take.steps)
        end, record = panel.step.number, panel.recorder.episodes()
    measures = measure_cell(policy.label, take.scenario, record).measures
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
