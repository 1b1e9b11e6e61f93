"""What becomes of walks that are interrupted: reload, sleep, a call, no network, an empty battery.

    python -m studies.benchmarks.lost_walks [--tries 20] [--kinds reload,call] [--seed N]

A real browser walks with planted motion and a fake microphone that hears chirps; the server maps.
In the middle of each walk something happens, and whoever walks does what the page offers: goes on,
or sends what there is. Printed is, for each kind, how many walks ended in a map, of how many the
page had said before it went on that they would not, and how many were lost. A map whose loops did
not close is a map of dead reckoning, and counts.
Needs chromium and the `test` extra.
"""

from __future__ import annotations

import argparse
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import soundfile
from playwright.sync_api import Page, Playwright, sync_playwright

from elfslam.base.values import Imu
from elfslam.line.chirp import ChirpParameters, make_chirp
from elfslam.world.device import BMI160
from elfslam.world.imu import read_imu
from elfslam.world.walker import random_walker, walk
from elfslam.world.world_file import load_world
from studies.benchmarks.browser_walk import CHROMIUM, INJECTED_HZ, PERMISSIONS, MotionSensors
from studies.benchmarks.served import serving

KINDS = ("reload", "sleep", "call", "offline", "battery")
OUTCOMES = ("ended in a map", "told before", "lost")
MICROPHONE_HZ = 44_100
ROOM = ((0.004, 0.02), (0.0093, 0.05), (0.021, 0.012), (0.037, 0.004))
"""Echoes of each chirp: seconds behind it, and how loud."""
PERIODS = 100
"""Of sound, which the fake microphone hears again and again."""
SETTING_OFF_S = 3.0
"""By then the simulated walker walks."""
PATIENCE_S = 120.0
ARGUMENTS = (
    "--headless=new",
    "--no-sandbox",
    "--disable-gpu",
    "--no-first-run",
    "--disable-background-networking",
    "--use-fake-ui-for-media-stream",
    "--use-fake-device-for-media-stream",
    "--mute-audio",
    "--window-size=390,844",
    "--remote-debugging-port=0",
)
TAKE_AWAY = """
const ask = navigator.mediaDevices?.getUserMedia.bind(navigator.mediaDevices);
let taken = [];
if (ask) navigator.mediaDevices.getUserMedia = async (wanted) => {
  const stream = await ask(wanted);
  taken = stream.getAudioTracks();
  return stream;
};
window.takeMicrophone = () => taken.forEach((track) => {
  track.stop();
  track.dispatchEvent(new Event("ended"));
});
"""
"""A call ends the track of the microphone; no browser lets a test make one."""


@dataclass
class Phone:
    """A browser with a profile of its own, whose process can be killed."""

    play: Playwright
    profile: Path
    sound: Path
    imu: Imu
    begun_s: float = 0.0

    def switch_on(self, address: str) -> Page:
        """Start it and open an address."""
        command = [CHROMIUM, *ARGUMENTS, f"--user-data-dir={self.profile}"]
        self._process = subprocess.Popen(
            [*command, f"--use-file-for-fake-audio-capture={self.sound}", "about:blank"],
            stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, start_new_session=True,
        )  # fmt: skip
        browser = self.play.chromium.connect_over_cdp(self._listening())
        self.context = browser.contexts[0]
        self.context.grant_permissions(list(PERMISSIONS), origin=address.partition("/#")[0])
        self.context.add_init_script(TAKE_AWAY)
        self.page = self.context.new_page()
        self.page.route("**/api/version", regular_chirps)
        self.page.on("dialog", lambda dialog: dialog.accept())
        self._sensors = MotionSensors(self.page)
        self.page.goto(address)
        return self.page

    def die(self) -> None:
        """The battery is empty."""
        os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait(20)

    def carry(self, seconds: float) -> None:
        """Walk on: what the motion sensors read while nothing is tapped."""
        self.carry_until(lambda: False, seconds)

    def carry_until(self, happened: Callable[[], bool], most_s: float = PATIENCE_S) -> bool:
        """Walk on until something has happened; whether it has."""
        until = time.monotonic() + most_s
        while time.monotonic() < until:
            if happened():
                return True
            self._sensors.read(self.imu, SETTING_OFF_S + time.monotonic() - self.begun_s)
        return False

    def freeze(self, seconds: float) -> None:
        """The page sleeps: timers, workers, events and the thread of the sound stand still."""
        pages = [pid for pid in _processes_of(self._process.pid) if _is_page(pid)]
        for pid in pages:
            os.kill(pid, signal.SIGSTOP)
        time.sleep(seconds)
        for pid in pages:
            os.kill(pid, signal.SIGCONT)

    def said(self) -> str:
        """What the page says of a walk that does not go on: that it told so, or nothing of it."""
        if self.page.is_visible("#problem"):
            return f"told before: {self.page.inner_text('#problem')}"
        return f"lost: the page says {self.page.inner_text('main')[:200]!r}"

    def _listening(self) -> str:
        assert self._process.stderr is not None
        for line in self._process.stderr:
            if found := re.search(r"ws://[\w.:]+", line):
                return found[0].replace("ws://", "http://")
        raise RuntimeError("the browser does not start")


def _processes_of(group: int) -> list[int]:
    """Those that a browser started, which leads a group of its own."""
    found = (int(each.name) for each in Path("/proc").glob("[0-9]*"))
    return [pid for pid in found if _group_of(pid) == group]


def _group_of(pid: int) -> int:
    try:
        return os.getpgid(pid)
    except ProcessLookupError:
        return 0


def _is_page(pid: int) -> bool:
    try:
        return b"--type=renderer" in Path(f"/proc/{pid}/cmdline").read_bytes()
    except OSError:
        return False


def regular_chirps(route: Any) -> None:
    """The fake microphone chirps once per period, whatever the page plays: so must the page."""
    answer = route.fetch()
    told = answer.json()
    told["medium_access"] |= {"jitter_s": 0, "forget": 0, "listen": 0, "check_alone": 0}
    route.fulfill(response=answer, json=told)


def write_sound(file: Path) -> Path:
    """What the fake microphone hears: a chirp with its echoes every 100 ms."""
    chirp = make_chirp(ChirpParameters(), MICROPHONE_HZ).samples
    period = MICROPHONE_HZ // 10
    frame = np.zeros(period)
    for delay_s, gain in ((0.0, 0.15), *ROOM):
        start = round((0.01 + delay_s) * MICROPHONE_HZ)
        frame[start : start + len(chirp)] += gain * chirp
    noise = 1e-4 * np.random.default_rng(7).standard_normal(PERIODS * period)
    soundfile.write(file, np.tile(frame, PERIODS) + noise, MICROPHONE_HZ, subtype="PCM_16")
    return file


def walking(seed: int) -> Imu:
    """What the motion sensors of somebody who walks round a room read."""
    generator = np.random.default_rng([seed, 1])
    walker, world = random_walker(generator), load_world("studio")
    motion = walk(walker, world.route_m, 20, generator)
    return read_imu(motion, replace(BMI160, rate_hz=INJECTED_HZ), generator)


def broken_walk(
    phone: Phone, address: str, kind: str, name: str, chance: np.random.Generator
) -> str:
    """Walk, have it interrupted, do what the page offers; what became of the walk."""
    page = phone.switch_on(address)
    phone.begun_s = time.monotonic()
    page.click("#allow")
    phone.carry_until(lambda: page.is_visible("#go-on"))
    page.click("#go-on")
    page.fill("#walk-name", name)
    page.click("text=Start walking")
    phone.carry_until(lambda: page.is_visible("#stop"))
    phone.carry(float(chance.uniform(4, 8)))
    INTERRUPTIONS[kind](phone, address, chance)
    if not phone.carry_until(lambda: phone.page.is_visible("#finish"), 30):
        return phone.said()
    return outcome_of(address, name, phone)


def outcome_of(address: str, name: str, phone: Phone) -> str:
    """Whether the server makes a map of a walk, or why not."""
    url, token = address.partition("&")[0].split("#token=")
    found: dict[str, Any] = {}

    def ended() -> bool:
        with httpx.Client(base_url=url, headers={"Authorization": f"Bearer {token}"}) as client:
            recordings = client.get("/api/recordings").raise_for_status().json()
            mine = [each for each in recordings if each["name"] == name]
            if not mine or mine[0]["state"] == "receiving":
                return False
            found["refusal"] = mine[0]["refusal"]
            jobs = client.get("/api/jobs", params={"recording": mine[0]["id"]}).json()
        if mine[0]["state"] == "refused":
            return True
        found["job"] = jobs[0] if jobs else None
        return bool(jobs) and jobs[0]["state"] in ("done", "failed")

    if not phone.carry_until(ended):
        return phone.said()
    job = found.get("job")
    if job and job["gave"].get("map"):
        lacks = ", ".join(
            f"{each['what']} {each['from_s']:.1f} to {each['until_s']:.1f} s"
            for each in job["gave"].get("missing", [])
        )
        return f"ended in a map: without {lacks or 'nothing'}"
    return f"lost: {found['refusal'] or (job and job['problem'])}"


def _go_on_or_stop(phone: Phone, chance: np.random.Generator) -> None:
    """Two of three walkers go on; the others send what there is."""
    page = phone.page
    going = page.is_visible("#unfinished >> text=Go on walking")
    if going and chance.random() < 2 / 3:
        page.click("#unfinished >> text=Go on walking")
        phone.carry_until(lambda: page.is_visible("#stop"))
        phone.carry(float(chance.uniform(4, 8)))
        page.click("#stop")
    else:
        page.click("#unfinished >> text=Continue sending")


def _reload(phone: Phone, address: str, chance: np.random.Generator) -> None:
    phone.page.reload()
    if not phone.carry_until(lambda: phone.page.is_visible("#unfinished"), 20):
        return
    phone.carry(float(chance.uniform(0, 4)))
    _go_on_or_stop(phone, chance)


def _battery(phone: Phone, address: str, chance: np.random.Generator) -> None:
    phone.die()
    time.sleep(float(chance.uniform(0, 3)))
    phone.switch_on(address)  # a phone that was paired a minute before has its cookie on the disk
    if not phone.carry_until(lambda: phone.page.is_visible("#unfinished"), 20):
        return
    _go_on_or_stop(phone, chance)


def _sleep(phone: Phone, address: str, chance: np.random.Generator) -> None:
    phone.freeze(float(chance.uniform(2, 6)))
    phone.carry(float(chance.uniform(4, 8)))
    phone.page.click("#stop")


def _call(phone: Phone, address: str, chance: np.random.Generator) -> None:
    page = phone.page
    page.evaluate("() => window.takeMicrophone()")
    if not phone.carry_until(lambda: page.is_visible("#resume"), 20):
        return
    phone.carry(float(chance.uniform(1, 5)))
    if chance.random() < 2 / 3:
        page.click("#resume")
        phone.carry_until(lambda: not page.is_visible("#resume"), 20)
        phone.carry(float(chance.uniform(4, 8)))
    page.click("#stop")


def _offline(phone: Phone, address: str, chance: np.random.Generator) -> None:
    phone.context.set_offline(True)
    phone.carry(float(chance.uniform(2, 6)))
    stops_offline = chance.random() < 1 / 2
    if stops_offline:
        phone.page.click("#stop")
        phone.carry(2.0)
    phone.context.set_offline(False)
    if not stops_offline:
        phone.carry(float(chance.uniform(2, 4)))
        phone.page.click("#stop")


INTERRUPTIONS: dict[str, Callable[[Phone, str, np.random.Generator], None]] = {
    "reload": _reload,
    "sleep": _sleep,
    "call": _call,
    "offline": _offline,
    "battery": _battery,
}


@contextmanager
def phone_in(play: Playwright, folder: Path, sound: Path, imu: Imu) -> Iterator[Phone]:
    """A phone that nobody used before."""
    with tempfile.TemporaryDirectory(dir=folder, ignore_cleanup_errors=True) as profile:
        phone = Phone(play, Path(profile), sound, imu)
        try:
            yield phone
        finally:
            phone.die()


def table_of(counts: dict[str, Counter[str]]) -> str:
    """A row for each kind of interruption."""
    head = f"| what happened | tries | {' | '.join(OUTCOMES)} |\n|---|---|---|---|---|"
    rows = [
        f"| {kind} | {found.total()} | {' | '.join(str(found[each]) for each in OUTCOMES)} |"
        for kind, found in counts.items()
    ]
    return "\n".join([head, *rows])


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--tries", type=int, default=20)
    parser.add_argument("--kinds", default=",".join(KINDS))
    parser.add_argument("--seed", type=int, default=107)
    parser.add_argument("--keep", type=Path, default=None)
    given = parser.parse_args()
    if not CHROMIUM:
        sys.exit("install first: chromium")
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as scratch:
        folder = given.keep or Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        print(table_of(tried(given.kinds.split(","), given.tries, given.seed, folder)))


def tried(kinds: list[str], tries: int, seed: int, folder: Path) -> dict[str, Counter[str]]:
    """What became of the walks, counted by what happened to them."""
    sound, imu = write_sound(folder / "heard.wav"), walking(seed)
    counts: dict[str, Counter[str]] = {kind: Counter() for kind in kinds}
    with serving(folder / "data") as address, sync_playwright() as play:
        for kind in kinds:
            for k in range(tries):
                chance = np.random.default_rng([seed, KINDS.index(kind), k])
                with phone_in(play, folder, sound, imu) as phone:
                    said = broken_walk(phone, address, kind, f"{kind} {k + 1}", chance)
                counts[kind][said.partition(":")[0]] += 1
                print(f"{kind} {k + 1}: {said}", flush=True)
    return counts


if __name__ == "__main__":
    main()
