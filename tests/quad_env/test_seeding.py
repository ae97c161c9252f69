"""Seed families are disjoint for any seed."""

from functools import cached_property

import numpy as np
import pytest

from quad_env.seeding import PURPOSES, EpisodeStreams, episode_seeds


def test_no_two_purposes_share_a_seed_and_neighbouring_seeds_share_none() -> None:
    drawn = [episode_seeds(purpose, seed, 500) for purpose in PURPOSES for seed in (0, 1, 2)]
    every = np.concatenate(drawn)
    assert len(np.unique(every)) == len(every)
    assert [set(part >> 48) for part in drawn[::3]] == [{i} for i in range(len(PURPOSES))]


def test_more_seeds_begin_with_the_fewer() -> None:
    assert (episode_seeds("search", 3, 100)[:40] == episode_seeds("search", 3, 40)).all()


def test_bad_arguments_are_named() -> None:
    with pytest.raises(ValueError, match="training, validation"):
        episode_seeds("exam", 0, 1)
    with pytest.raises(ValueError, match="negative"):
        episode_seeds("search", -1, 1)


def test_streams_of_an_episode_are_independent_of_each_other_and_of_other_episodes() -> None:
    first, again, other = EpisodeStreams(1, 0), EpisodeStreams(1, 0), EpisodeStreams(1, 1)
    again.start.random(100)
    assert first.commands.random() == again.commands.random()
    assert first.pushes.random() != other.pushes.random()


def test_every_kind_of_draw_has_a_stream_of_its_own() -> None:
    kinds = [name for name, value in vars(EpisodeStreams).items() if isinstance(value, cached_property)]
    assert {"force", "payload", "noise", "sensors"} < set(kinds)
    streams = EpisodeStreams(1, 0)
    assert len({getattr(streams, kind).random() for kind in kinds}) == len(kinds)
