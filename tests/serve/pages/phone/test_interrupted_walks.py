"""Walks that something interrupts: each goes on, and the page says at once while it does not."""

import json
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from elfslam.data.recordings import read_recording
from tests.serve.pages.phone.test_phone_page import Heard, check_sound

pytestmark = pytest.mark.real

CAUGHT = """
const contexts = [];
let toldToResume = 0;
let tracks = [];
window.AudioContext = class extends AudioContext {
  constructor(...given) {
    super(...given);
    contexts.push(this);
  }

  get state() {
    return this.isTaken ? "interrupted" : super.state;
  }

  resume() {
    if (this.isTaken) toldToResume += 1;
    return super.resume();
  }
};
const ask = navigator.mediaDevices?.getUserMedia.bind(navigator.mediaDevices);
if (ask) navigator.mediaDevices.getUserMedia = async (wanted) => {
  const stream = await ask(wanted);
  tracks = stream.getAudioTracks();
  return stream;
};
window.happen = {
  taken: () => tracks.forEach((track) => {
    track.stop();
    track.dispatchEvent(new Event("ended"));
  }),
  silent: () => tracks.forEach((track) => track.dispatchEvent(new Event("mute"))),
  heard: () => tracks.forEach((track) => track.dispatchEvent(new Event("unmute"))),
  suspended: () => contexts.at(-1).suspend(),
  resumed: () => contexts.at(-1).resume(),
  interrupted: () => {
    contexts.at(-1).isTaken = true;
    return contexts.at(-1).suspend();
  },
  seen: () => document.dispatchEvent(new Event("visibilitychange")),
  counted: () => toldToResume,
};
"""
"""No test can make a call: what a browser tells a page of one is told here."""
OTHER_RATE = """
window.AudioContext = class extends AudioContext {
  constructor(given) {
    super({ ...given, sampleRate: 48000 });
  }
};
"""


def happen(phone: Any, what: str) -> Any:
    return phone.page.evaluate("(what) => window.happen[what]()", what)


def times_s(folder: Path, table: str) -> np.ndarray:
    return np.loadtxt(folder / table, delimiter=",", skiprows=1, usecols=0, ndmin=1)


def check_holes(folder: Path, count: int) -> None:
    """Chirps and sound have the same holes; what was before them and after them is all there."""
    holes = []
    for table in ("baseband.csv", "chirps.csv"):
        t_s = times_s(folder, table)
        gaps_s = np.diff(t_s)
        assert (gaps_s > 0).all()
        (at,) = np.nonzero(gaps_s > 1.0)
        assert len(at) == count
        assert (np.diff([0, *at, len(t_s)]) >= 20).all()
        holes.append((t_s[at], t_s[at + 1]))
    assert np.allclose(holes[0], holes[1], atol=1.5)
    moved_s = times_s(folder, "accelerometer.csv")
    assert (np.diff(moved_s) > 0).all()
    assert np.sum(np.diff(moved_s) > 0.5) >= count
    manifest = json.loads((folder / "recording.json").read_text())
    assert sum(gap["lost_s"] >= 0.9 for gap in manifest["capture"]["gaps"]) == count
    recording = read_recording(folder)
    assert recording.audio is not None
    assert recording.imu is not None


def test_a_walk_goes_on_after_a_reload(phone: Any) -> None:
    phone.begin("Broken off")
    phone.record(20)
    phone.page.reload()
    phone.wait_for_text("#unfinished", "Nothing is recorded until you go on")
    phone.page.click("text=Go on walking")
    phone.wait_for(lambda: phone.page.is_visible("#stop"), "the walk goes on")
    assert phone.text("#record-title") == "Broken off"
    assert phone.text("#recording-badge").lower() == "recording"
    phone.record(20)
    check_holes(phone.finish()[0], 1)
    phone.open_again()
    phone.walk(1)
    assert not phone.page.is_visible("#unfinished")


def test_each_interruption_is_said_at_once_and_the_walk_goes_on(phone: Any) -> None:
    """A call, a dark screen, Siri, a muted microphone, and another call, which ends the walk."""
    phone.page.add_init_script(CAUGHT)
    phone.begin("Called")
    phone.record(20)

    happen(phone, "taken")
    phone.wait_for_text("#pause", "The microphone was taken away, as by a call. Nothing is rec")
    assert phone.text("#recording-badge").lower() == "interrupted"
    phone.walk(1)
    before = phone.text("#kept")
    phone.walk(1.5)
    assert phone.text("#kept") == before
    phone.page.click("#resume")
    goes_on(phone)

    happen(phone, "suspended")
    phone.wait_for_text("#pause", "The sound was interrupted. Nothing is recorded")
    phone.walk(1.5)
    happen(phone, "resumed")
    goes_on(phone)

    happen(phone, "interrupted")
    phone.wait_for_text("#pause", "The sound was interrupted. Nothing is recorded")
    happen(phone, "seen")
    phone.walk(1.5)
    phone.page.click("#resume")
    goes_on(phone)
    assert happen(phone, "counted") == 0, "interrupted sound is never told to go on"

    happen(phone, "silent")
    phone.wait_for_text("#pause", "The microphone is silent, as in a call. The walk goes on")
    assert not phone.page.is_visible("#resume")
    assert phone.text("#recording-badge").lower() == "recording"
    happen(phone, "heard")
    goes_on(phone)

    happen(phone, "taken")
    phone.wait_for(lambda: phone.page.is_visible("#resume"), "it is said")
    check_holes(phone.finish()[0], 3)


def goes_on(phone: Any) -> None:
    phone.wait_for(lambda: not phone.page.is_visible("#pause"), "the walk goes on")
    phone.record(20)


def test_a_page_that_slept_says_for_how_long(phone: Any) -> None:
    phone.begin("Asleep")
    phone.walk(2)
    phone.sensors.send("Debugger.enable")
    phone.sensors.send("Debugger.pause")
    time.sleep(3.5)
    phone.sensors.send("Debugger.resume")
    phone.sensors.send("Debugger.disable")
    phone.wait_for_text("#pause", "This page was asleep for 0:0")
    assert not phone.page.is_visible("#resume")
    phone.walk(2)
    folder, _ = phone.finish()
    assert np.diff(times_s(folder, "accelerometer.csv")).max() > 2.5
    assert times_s(folder, "baseband.csv")[-1] > 6


def test_a_walk_of_which_the_sound_ran_otherwise_can_only_be_sent(phone: Any, heard: Heard) -> None:
    phone.begin("Other sound")
    phone.walk(4)
    phone.page.add_init_script(OTHER_RATE)
    phone.page.reload()
    phone.wait_for_text("#unfinished", "Other sound")
    phone.page.click("text=Go on walking")
    phone.wait_for_text("#problem", "The sound runs at 48 kHz now and ran at 44.1 kHz before: send")
    phone.wait_for_text("#unfinished", "Other sound")
    phone.page.click("text=Continue sending")
    phone.wait_for_text("#finish-said", "map is being made")
    folder, _ = phone.fetch()
    check_sound(folder, heard)
    assert len(times_s(folder, "baseband.csv")) > 15
