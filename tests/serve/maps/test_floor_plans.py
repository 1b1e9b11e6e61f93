"""Plans that cost more than they may: refused with the limit named, and nobody else waits."""

import io
import random
import resource
import signal
import threading
from collections.abc import Callable
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, as_completed, wait
from contextlib import suppress
from pathlib import Path
from typing import Any

import httpx
import pytest
from PIL import Image
from planted_plans import pdf

from elfslam.data.plan_pictures import NAMESPACE
from elfslam.serve.parsing.children import OF_ONE, WAITING, Children
from elfslam.serve.services import Services
from elfslam.serve.settings import Limits, ServerSettings
from tests import hostile_plans
from tests.hostile_plans import GEOJSON, JPEG, PDF, PNG, SVG
from tests.serve.conftest import Maps, Somebody
from tests.serve.planting import plant_floor_map, put_plan
from tests.waiting import PATIENCE_S, until

SLACK_KIB = 2**15
CHILD_KIB = 400 * 2**10
"""What a child may have in memory: its bound, and the libraries that it reads in."""
MANY_MASKS = hostile_plans.masks(90)


@pytest.fixture
def drawing_s(request: pytest.FixtureRequest) -> float:
    """The processor time that drawing a plan may take."""
    return float(getattr(request, "param", 1.0))


@pytest.fixture
def settings(tmp_path: Path, drawing_s: float) -> ServerSettings:
    limits = Limits(drawing_s=drawing_s, token_requests_per_s=1000, address_requests_per_s=1000)
    return ServerSettings(tmp_path / "data", secure_cookie=False, run_jobs=False, limits=limits)


@pytest.mark.hostile
@pytest.mark.parametrize(
    ("drawing_s", "make", "kind", "words"),
    [
        (20, hostile_plans.masks, SVG, "has more than 100 masks"),
        (1, lambda: MANY_MASKS, SVG, "needs more than 1 s of processor time"),
        (20, hostile_plans.mask_chain, SVG, "name each other in more than 100 levels"),
        (20, lambda: hostile_plans.mask_chain(15), SVG, "needs more than 320 MB of memory"),
        (20, hostile_plans.nested_opacity, SVG, "20 masked, clipped or translucent groups"),
        (20, lambda: hostile_plans.nested_opacity(18), SVG, "needs more than 320 MB of memory"),
        (20, hostile_plans.uses_of_uses, SVG, "cannot be drawn (SVG data parsing failed"),
        (20, lambda: hostile_plans.unfolding_pdf(400_000_000), PDF, "needs more than 320 MB"),
        (20, lambda: hostile_plans.operator_pdf(5_000_000), PDF, "needs more than 320 MB"),
        (20, lambda: hostile_plans.png_bomb(6400), PNG, "more than 40 million; make it smaller"),
        (20, lambda: hostile_plans.scanned_jpeg(200, 800), JPEG, "more than 100 scans"),
        (1, lambda: hostile_plans.scanned_jpeg(97), JPEG, "needs more than 1 s of processor time"),
        (20, hostile_plans.deep_geojson, GEOJSON, "nested too deep"),
    ],
    indirect=["drawing_s"],
)
def test_a_costly_plan_is_refused_with_the_limit_named(
    owner: Somebody, services: Services, make: Callable[[], bytes], kind: str, words: str
) -> None:
    map_id = owner.put_map()
    content = make()
    earlier_kib = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
    answer = put_plan(owner, map_id, content, kind)
    assert answer.status_code == 422, answer.text
    assert words in answer.json()["detail"]
    # Linux counts what this process holds as its child's, until that has become another program.
    own_kib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss + SLACK_KIB
    most_kib = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
    assert most_kib <= max(earlier_kib, own_kib, CHILD_KIB)
    assert owner.get(f"/api/maps/{map_id}").json()["floor_plan"] is None
    assert list(services.settings.work_folder.iterdir()) == []


def noise(mode: str, width: int, height: int, file_format: str, **how: Any) -> bytes:
    small = Image.frombytes(mode, (width // 8, height // 8), random.Random(0).randbytes(
        width // 8 * (height // 8) * len(mode)
    ))  # fmt: skip
    made = io.BytesIO()
    small.resize((width, height), Image.Resampling.NEAREST).save(made, file_format, **how)
    return made.getvalue()


def large_svg(elements: int = 20_000) -> bytes:
    shapes = "".join(
        f'<path d="M{k % 200 * 5} {k // 200 * 9}l4 3 1 2z" stroke="black" stroke-width="0.3"/>'
        for k in range(elements)
    )
    return f'<svg xmlns="{NAMESPACE}" viewBox="0 0 1000 1000">{shapes}</svg>'.encode()


def large_pdf() -> bytes:
    """An A1 sheet with 100,000 short lines."""
    lines = "".join(
        f"{k % 400 * 5} {k // 400 * 6} m {k % 400 * 5 + 4} {k // 400 * 6 + 3} l S\n"
        for k in range(100_000)
    )
    return pdf(drawing=lines.encode(), size="2384 1684")


@pytest.mark.hostile
@pytest.mark.parametrize("drawing_s", [Limits.drawing_s], indirect=True)
@pytest.mark.parametrize(
    ("make", "kind"),
    [
        (lambda: noise("RGBA", 4000, 2560, "PNG"), PNG),
        (lambda: noise("RGB", 6240, 6240, "JPEG", progressive=True, subsampling=0), JPEG),
        (lambda: hostile_plans.png_bomb(6320), PNG),
        (large_svg, SVG),
        (lambda: hostile_plans.nested_opacity(4), SVG),
        (large_pdf, PDF),
        (pdf, PDF),
    ],
    ids=["10 MP PNG", "39 MP JPEG", "40 MP PNG", "20,000 shapes", "opacity", "A1", "small"],
)
def test_an_honest_large_plan_is_taken(
    owner: Somebody, make: Callable[[], bytes], kind: str
) -> None:
    answer = put_plan(owner, owner.put_map(), make(), kind)
    assert answer.status_code == 200, answer.text


class HeldParser:
    """Stands for the children: parses nothing, holds whose plan says so until it is opened."""

    def __init__(self) -> None:
        self.at_it = self.most = 0
        self.begins, self.opened = threading.Semaphore(0), threading.Event()
        self._lock = threading.Lock()

    def parse(self, _module: str, _bounds: object, file: str, level: str | None) -> object:
        if Path(file).read_bytes() == b"hold":
            with self._lock:
                self.at_it += 1
                self.most = max(self.most, self.at_it)
            self.begins.release()
            self.opened.wait(PATIENCE_S)
            with self._lock:
                self.at_it -= 1
        return {"type": PNG, "width_px": 1, "height_px": 1, "width_m": None}


def test_two_of_one_users_plans_at_a_time_and_others_are_unaffected(
    ada: Somebody, eve: Somebody, monkeypatch: pytest.MonkeyPatch
) -> None:
    held, more = HeldParser(), 5
    monkeypatch.setattr(Children, "parse", held.parse)
    hers, mine = eve.put_map(), ada.put_map()
    with ThreadPoolExecutor(OF_ONE + WAITING + more) as threads:
        sent = [
            threads.submit(put_plan, eve, hers, b"hold", PNG)
            for _ in range(OF_ONE + WAITING + more)
        ]
        for _ in range(OF_ONE):
            assert held.begins.acquire(timeout=PATIENCE_S)
        refused = _first(sent, more)
        assert {each.status_code for each in refused} == {429}
        assert {each.headers["retry-after"] for each in refused} == {"10"}
        assert put_plan(ada, mine, b"mine", PNG).status_code == 200, "while all of Eve's wait"
        assert len(ada.get("/api/maps").json()) == 1
        assert ada.post("/api/recordings", json={"name": "walk"}).status_code == 201
        held.opened.set()
        statuses = [each.result().status_code for each in as_completed(sent)]
    assert sorted(statuses) == [200] * (OF_ONE + WAITING) + [429] * more
    assert held.most == OF_ONE


def _first(sent: list[Future[Any]], count: int) -> list[Any]:
    """The answers that came first, so many."""
    left, done = set(sent), set[Future[Any]]()
    while len(done) < count:
        came, left = wait(left, return_when=FIRST_COMPLETED)
        done |= came
    return [each.result() for each in done]


def children_of(process: int) -> list[int]:
    told = Path(f"/proc/{process}/task").glob("*/children")
    return [int(each) for file in told for each in file.read_text().split()]


def forked_by(server: int) -> list[int]:
    """The children of the process from which a server has its children forked."""
    return [child for nest in children_of(server) for child in children_of(nest)]


def test_a_server_that_is_stopped_waits_for_no_plan(
    start_server: Callable[..., Any], maps: Maps
) -> None:
    served = start_server(drawing_s=600.0)
    map_id = plant_floor_map(served.data, maps[0])
    with served.client() as owner, ThreadPoolExecutor() as threads:
        sent = threads.submit(put_plan, owner, map_id, MANY_MASKS, SVG)
        (child,) = until(lambda: forked_by(served.process.pid), "a child that draws")
        served.process.send_signal(signal.SIGTERM)
        with suppress(httpx.TransportError):  # it may have closed the connection already
            assert sent.result().status_code == 503
        assert served.process.wait(120) == -signal.SIGTERM
    assert not Path(f"/proc/{child}").exists()
