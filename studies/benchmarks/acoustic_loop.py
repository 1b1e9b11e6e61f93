"""A loudspeaker, a simulated room and a microphone for a real browser, and no human.

Null sinks of a private PulseAudio stand for loudspeaker and microphones. A process of its own,
the room, reads what the browser plays; at every chirp it takes the response of the world at the
place where the walker is then, convolves, and plays the result into each microphone.

    python -m studies.benchmarks.acoustic_loop \\
        RESPONSES.npy SEED NAME=GAIN...    is the room (started by `room_between`)
"""

import multiprocessing
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from elfslam.world.interference import rumble

RATE_HZ = 48_000
FRAME = RATE_HZ // 10
BLOCK = 240
HEARD = 720
"""Samples of a chirp that must be there before its echoes can be worked out."""
LAG = 1920
"""Samples by which the room answers late: 40 ms, as phones do between playing and recording."""
SILENCE = 1e-6
TICK_S, JITTER_S = 0.01, 0.02
"""Between two beats of the metronome, and what one may be late on a machine that is in time."""
PROGRAMS = ("pulseaudio", "parec", "pacat")
STARTUP_S = 10.0
DAEMON = """
load-module module-native-protocol-unix auth-anonymous=1 socket={socket}
load-module module-null-sink sink_name=loudspeaker rate={rate} channels=1 format=float32le
set-default-sink loudspeaker
"""
EAR = """
load-module module-null-sink sink_name={name}_air rate={rate} channels=1 format=float32le
load-module module-remap-source master={name}_air.monitor source_name={name} channels=1 \
  source_properties=device.description={name}
"""
ONE_MICROPHONE = {"Microphone": 1.0}


def missing_programs() -> list[str]:
    """What has to be installed first."""
    return [name for name in PROGRAMS if shutil.which(name) is None]


@contextmanager
def in_time() -> Iterator[None]:
    """What is started within goes before other work, where this user may ask for it.

    Sound that comes late is sound that is lost.
    """
    before = os.sched_getscheduler(0), os.sched_getparam(0)
    with suppress(PermissionError):
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1))
    try:
        yield
    finally:
        os.sched_setscheduler(0, *before)


@contextmanager
def metronome() -> Iterator[Callable[[], float]]:
    """How long a process that only sleeps was held up so far (s): the machine's own lateness.

    It knows nothing of page, sound server and room, so that what they lose while it is in time
    is theirs.
    """
    spawn = multiprocessing.get_context("spawn")
    held_up_s, ticking = spawn.Value("d", 0.0), spawn.Event()
    process = spawn.Process(target=_tick, args=(held_up_s, ticking), daemon=True)
    process.start()
    try:
        while not ticking.wait(1.0):
            if not process.is_alive():
                raise RuntimeError(f"the metronome ended by itself: {process.exitcode}")
        yield lambda: held_up_s.value
    finally:
        process.terminate()
        process.join()


def _tick(held_up_s: Any, ticking: Any) -> None:
    """Sleep again and again, and add up by how much too long where that is more than jitter."""
    ticking.set()
    while True:
        begun_s = time.monotonic()
        time.sleep(TICK_S)
        late_s = time.monotonic() - begun_s - TICK_S
        if late_s > JITTER_S:
            held_up_s.value += late_s


@contextmanager
def pulse_audio(
    folder: Path, microphones: Iterable[str] = ONE_MICROPHONE
) -> Iterator[dict[str, str]]:
    """A private sound server; gives the environment of programs that are to use it.

    The first of the microphones is what a browser takes that is not told otherwise.
    """
    socket, script = folder / "pulse.socket", folder / "pulse.pa"
    ears = [EAR.format(name=name, rate=RATE_HZ) for name in microphones]
    default = f"set-default-source {next(iter(microphones))}\n"
    script.write_text(DAEMON.format(socket=socket, rate=RATE_HZ) + "".join(ears) + default)
    settings = folder / "daemon.conf"
    settings.write_text(f"default-sample-rate = {RATE_HZ}\nalternate-sample-rate = {RATE_HZ}\n")
    own = {
        "PULSE_RUNTIME_PATH": str(folder),
        "PULSE_STATE_PATH": str(folder),
        "PULSE_CONFIG": str(settings),
    }
    environment = {**os.environ, **own, "PULSE_SERVER": f"unix:{socket}"}
    options = [
        "-n",
        "-F",
        str(script),
        "--exit-idle-time=-1",
        "--daemonize=no",
        "--use-pid-file=no",
    ]
    quiet = ["--disallow-exit", "--log-level=error", "--realtime=no", "--high-priority=no"]
    command = ["pulseaudio", *options, *quiet]
    with subprocess.Popen(command, env={**os.environ, **own}, stderr=subprocess.DEVNULL) as daemon:
        try:
            _wait_for(socket, daemon)
            _hurry(daemon.pid)
            yield environment
        finally:
            daemon.terminate()


def _hurry(process: int) -> None:
    """The daemon takes itself back to ordinary work; put its threads where this process is."""
    for thread in Path(f"/proc/{process}/task").iterdir():
        with suppress(PermissionError, ProcessLookupError):
            os.sched_setscheduler(int(thread.name), os.sched_getscheduler(0), os.sched_getparam(0))


def _wait_for(socket: Path, daemon: subprocess.Popen[bytes]) -> None:
    until = time.monotonic() + STARTUP_S
    while not socket.exists():
        if daemon.poll() is not None or time.monotonic() > until:
            raise RuntimeError("pulseaudio does not start; run it by hand to see why")
        time.sleep(0.05)
    time.sleep(0.3)


class Room:
    """The room's process: the walker stands at the start of the walk until told to go."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self._process = process

    def go(self) -> None:
        """The next chirp after a silence is the first of the walk."""
        assert self._process.stdin is not None
        self._process.stdin.write("go\n")
        self._process.stdin.flush()

    def begun_s(self) -> float:
        """When that chirp was played, on the clock of time.monotonic. Waits for it."""
        assert self._process.stdout is not None
        word, when = self._process.stdout.readline().split()
        assert word == "begun"
        return float(when)


@contextmanager
def room_between(
    environment: dict[str, str],
    responses: np.ndarray,
    folder: Path,
    seed: int = 0,
    microphones: Mapping[str, float] = ONE_MICROPHONE,
) -> Iterator[Room]:
    """A room that answers chirp c of the walk by transfer function c (n, FRAME / 2 + 1).

    Each microphone hears it by its own gain over noise that is alike; by a gain of 0, nothing.
    """
    file = folder / "responses.npy"
    np.save(file, responses.astype(np.complex64))
    gains = [f"{name}={gain}" for name, gain in microphones.items()]
    command = [sys.executable, __file__, str(file), str(seed), *gains]
    with subprocess.Popen(
        command,
        env={**environment, "OMP_NUM_THREADS": "1"},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        try:
            assert process.stdout is not None
            assert process.stdout.readline() == "ready\n"
            yield Room(process)
        finally:
            process.terminate()


@dataclass
class Line:
    """Echoes that are still to be played; `start` is the index of its first sample."""

    samples: np.ndarray
    start: int = 0

    def add(self, at: int, sound: np.ndarray) -> None:
        """Lay a sound down; it must not have been played yet."""
        first = max(at - self.start, 0)
        self.samples[first : first + len(sound)] += sound[: len(self.samples) - first]

    def take(self, count: int) -> np.ndarray:
        """The next samples."""
        taken = self.samples[:count].copy()
        self.samples[:-count] = self.samples[count:]
        self.samples[-count:] = 0
        self.start += count
        return taken


def answer(responses: np.ndarray, seed: int, microphones: Mapping[str, float]) -> None:
    """Read what is played and play what is heard, until stopped."""
    os.set_blocking(sys.stdin.fileno(), False)
    generator = np.random.default_rng(seed)
    noise = rumble(10 * RATE_HZ, RATE_HZ, generator) + np.float32(2e-5) * generator.standard_normal(
        10 * RATE_HZ, dtype=np.float32
    )
    form = ["--format=float32le", f"--rate={RATE_HZ}", "--channels=1", "--raw"]
    ears = subprocess.Popen(
        ["parec", "--device=loudspeaker.monitor", "--latency-msec=20", *form],
        stdout=subprocess.PIPE,
    )
    mouths = {
        name: subprocess.Popen(
            ["pacat", f"--device={name}_air", "--latency-msec=150", *form], stdin=subprocess.PIPE
        )
        for name in microphones
    }
    assert ears.stdout is not None
    print("ready", flush=True)
    line, played = Line(np.zeros(4 * FRAME, dtype=np.float32), -LAG), np.zeros(0, dtype=np.float32)
    read, silent_from, asked = 0, 0, False
    begun: int | None = None
    pending: int | None = None
    while True:
        block = np.frombuffer(ears.stdout.read(4 * BLOCK), dtype=np.float32)
        now = time.monotonic()
        asked = asked or bool(sys.stdin.readline())
        played = np.concatenate([played, block])[-4 * FRAME :]
        loud = np.flatnonzero(np.abs(block) > SILENCE)
        if pending is None and len(loud) and read + loud[0] - silent_from > FRAME // 4:
            pending = read + int(loud[0])
            was_pause = pending - silent_from > 3 * FRAME
            if begun is None and asked and was_pause:
                begun = pending
                print("begun", now - (read + len(block) - pending) / RATE_HZ, flush=True)
        if len(loud):
            silent_from = read + int(loud[-1])
        read += len(block)
        if pending is not None and read >= pending + HEARD:
            start = len(played) - (read - pending)
            heard = played[start : start + HEARD]
            chirp = 0 if begun is None else round((pending - begun) / FRAME)
            response = responses[min(chirp, len(responses) - 1)]
            sound = np.fft.irfft(np.fft.rfft(heard, FRAME) * response, FRAME)
            line.add(pending, sound.astype(np.float32))
            pending = None
        at = (read // BLOCK * BLOCK) % (len(noise) - BLOCK)
        heard, around = line.take(len(block)), noise[at : at + len(block)]
        for name, gain in microphones.items():
            mouth = mouths[name].stdin
            assert mouth is not None
            mouth.write((gain * heard + np.sign(gain) * around).astype(np.float32).tobytes())
            mouth.flush()


if __name__ == "__main__":
    named = (each.split("=") for each in sys.argv[3:])
    answer(np.load(sys.argv[1]), int(sys.argv[2]), {name: float(gain) for name, gain in named})
