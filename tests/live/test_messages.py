"""What is published is JSON by its schema, in degrees, metres and UTC, and never NaN."""

import json
from typing import get_args, get_type_hints

import numpy as np
import pytest

from whichroad import GeoFix, Localizer
from whichroad.live.messages import Around, EstimateMessage, Messages, iso


@pytest.fixture(scope="module")
def fixes(observations):
    return [one for one in observations if isinstance(one, GeoFix)]


def follows(value, kind):
    """Whether a value is what its TypedDict says, key by key."""
    if hasattr(kind, "__total__"):
        hints = get_type_hints(kind)
        return (
            isinstance(value, dict)
            and value.keys() == hints.keys()
            and all(follows(value[name], hint) for name, hint in hints.items())
        )
    if getattr(kind, "__origin__", None) is list:
        return isinstance(value, list) and all(follows(v, get_args(kind)[0]) for v in value)
    if get_args(kind):
        return any(follows(value, one) for one in get_args(kind))
    return value is None if kind is type(None) else type(value) is kind


def test_a_message_follows_its_schema_from_the_first_moment_on(town, fixes):
    localizer, messages = Localizer(town), Messages(town)
    silent = messages.estimate(localizer.predict(0.0), Around())
    assert follows(silent, EstimateMessage)
    assert (silent["answered"], silent["pose"], silent["hypotheses"]) == (False, None, [])
    for seq, fix in enumerate(fixes):
        said = messages.estimate(localizer.update(fix), Around(seq=seq, fix=fix))
        assert follows(said, EstimateMessage)
        json.dumps(said, allow_nan=False)
    assert said["answered"]
    assert said["road"]["source_id"] is not None
    assert said["hypotheses"][0]["edge_id"] == said["road"]["edge_id"]
    assert sum(h["p"] for h in said["hypotheses"]) == pytest.approx(1.0, abs=1e-4)
    assert said["fix"]["age_s"] == 0.0


def test_ellipses_are_turned_to_true_north(town, fixes):
    localizer, messages = Localizer(town), Messages(town)
    fix = GeoFix(fixes[0].time, fixes[0].lat_deg, fixes[0].lon_deg, 4.0, 0.0, 100.0)
    ellipse = messages.estimate(localizer.update(fix), Around(fix=fix))["fix"]["ellipse"]
    assert ellipse["bearing_deg"] == pytest.approx(0.0, abs=1e-6)
    assert (ellipse["major_m"], ellipse["minor_m"]) == (10.0, 2.0)


def test_the_95_percent_radius_holds_that_share_of_the_mixture(town, fixes):
    localizer, messages = Localizer(town), Messages(town)
    for fix in fixes[:20]:
        estimate = localizer.update(fix)
    rng = np.random.default_rng(1)
    drawn = np.concatenate(
        [
            rng.multivariate_normal((h.pose.x, h.pose.y), h.cov[:2, :2], int(100_000 * h.p))
            for h in estimate.hypotheses
        ]
    )
    away = np.hypot(*(drawn - (estimate.pose.x, estimate.pose.y)).T)
    radius = messages.estimate(estimate, Around())["radius95_m"]
    assert np.quantile(away, 0.95) <= radius <= 4.0 * np.quantile(away, 0.95)


def test_times_are_utc_to_the_millisecond():
    assert iso(1_780_300_920.1004) == "2026-06-01T08:02:00.100Z"
    assert iso(0.9996) == "1970-01-01T00:00:01.000Z"
