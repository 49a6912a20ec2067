"""The clock of a replay, and who looks on."""

import asyncio
from typing import Any

import pytest

from whichroad.replay.open_replay import Remaking
from whichroad.replay.player import TICK, Player, Refused
from whichroad.replay.recorded_messages import RecordedMessages


def run(story: Any) -> None:
    asyncio.run(asyncio.wait_for(story, 30))


def test_time_passes_as_fast_as_it_is_asked_to_and_stands_when_paused(recorded: RecordedMessages):
    async def story() -> None:
        player = Player(recorded)
        running = asyncio.create_task(player.run())
        await player.control("speed", 20)
        while player.position < 5.0:
            await asyncio.sleep(TICK)
        await player.control("pause")
        stood = player.position
        await asyncio.sleep(4 * TICK)
        assert player.position == stood
        running.cancel()

    run(story())


def test_a_step_is_one_epoch_and_leaves_the_clock_paused(recorded: RecordedMessages):
    async def story() -> None:
        player = Player(recorded)
        await player.control("seek", 100.0)
        before = player.message["epoch_s"]
        await player.control("step")
        assert player.paused
        assert player.message["epoch_s"] > before
        assert recorded.at(player.position) == recorded.at(100.0) + 1

    run(story())


def test_it_stops_at_the_end_and_begins_again_when_resumed(recorded: RecordedMessages):
    async def story() -> None:
        player = Player(recorded)
        await player.control("seek", 1e8)
        assert player.message["play"]["position_s"] == pytest.approx(recorded.length, abs=1e-3)
        assert player.paused
        await player.control("resume")
        assert player.position == 0.0

    run(story())


def test_masking_answers_anew_from_there_and_unmasking_gives_gnss_back(
    recorded: RecordedMessages, remaking: Remaking
):
    async def story() -> None:
        player = Player(recorded, remaking)
        await player.control("seek", 90.0)
        await player.control("mask")
        assert player.message["gnss_masked"]
        await player.control("seek", 129.0)
        k = recorded.at(129.0)
        assert (
            player.recorded.columns["ellipse_major_m"][k] > recorded.columns["ellipse_major_m"][k]
        )
        await player.control("unmask")
        await player.control("seek", 140.0)
        assert not player.message["gnss_masked"]
        assert player.recorded.is_masked(recorded.time[k - 1])

    run(story())


def test_a_looker_on_is_told_of_a_new_timeline_and_of_the_newest_message_only(
    recorded: RecordedMessages, remaking: Remaking
):
    async def story() -> None:
        player = Player(recorded, remaking)
        messages = player.messages()
        assert (await anext(messages))["type"] == "estimate"
        for second in range(10, 60, 10):
            await player.control("seek", second)
        newest = await anext(messages)
        assert newest["play"]["position_s"] == 50.0
        await player.control("mask")
        assert (await anext(messages))["type"] == "timeline"
        await messages.aclose()

    run(story())


@pytest.mark.parametrize(
    ("action", "value"),
    [
        ("seek", "soon"), ("seek", -1), ("seek", float("nan")), ("seek", True), ("seek", None),
        ("speed", 0), ("speed", 1e9), ("speed", []), ("fly", None), ([], None), ("mask", None),
    ],
)  # fmt: skip
def test_what_cannot_be_done_is_refused(recorded: RecordedMessages, action: Any, value: Any):
    with pytest.raises(Refused):
        asyncio.run(Player(recorded).control(action, value))
