"""Positions are told by who may be in a map, seen by who may see it, and kept for a while."""

from datetime import timedelta

import pytest
from sqlalchemy import func, select
from sqlalchemy.exc import OperationalError

from elfslam.serve.positions import routes
from elfslam.serve.positions.hub import HistoryBuffer
from elfslam.serve.positions.routes import delete_history, forget_old_positions, write_history
from elfslam.serve.services import Services
from elfslam.serve.store.database import reading, transaction
from elfslam.serve.store.sweeps import sweeping
from elfslam.serve.store.tables import Building, Floor, KeptPosition, now_utc
from tests.serve.conftest import DATABASES, Somebody, allow
from tests.serve.positions.conftest import Message, position
from tests.waiting import until

pytestmark = DATABASES
HISTORY, FLOOR = "/api/positions", "f" * 32


def live_of(map_id: str) -> str:
    return f"/api/maps/{map_id}/positions"


def kept(services: Services) -> int:
    write_history(services)
    return written(services)


def written(services: Services) -> int:
    with reading(services.sessions) as session:
        return session.scalar(select(func.count()).select_from(KeptPosition)) or 0


def publish_floor(services: Services) -> None:
    with transaction(services.sessions) as session:
        session.add(Building(number=1, name="Mall"))
        session.flush()
        place = {"latitude_deg": 47.0, "longitude_deg": 8.0, "radius_m": 9.0, "has_wifi": False}
        session.add(Floor(id=FLOOR, building=1, level=0, revision=1, manifest="{}", **place))


def test_a_position_is_shown_and_kept(owner: Somebody, map_id: str, message: Message) -> None:
    assert owner.post(HISTORY, json=message()).status_code == 204
    [live] = owner.get(live_of(map_id)).json()
    [mine] = owner.get(HISTORY).json()
    assert live == mine
    assert (live["x_m"], live["y_m"], live["heading_rad"], live["sigma_m"]) == (1.0, 2.0, 0.5, 0.2)
    assert (live["name"], live["status"], live["latitude_deg"]) == ("owner", "OK", None)
    assert live["time_utc"].endswith("Z")


def test_without_a_place_a_walker_is_there_all_the_same(
    owner: Somebody, map_id: str, message: Message
) -> None:
    lost = message(status="UNKNOWN_PLACE", x_m=None, y_m=None, heading_rad=None, sigma_m=None)
    assert owner.post(HISTORY, json=lost).status_code == 204
    [live] = owner.get(live_of(map_id)).json()
    assert (live["x_m"], live["status"]) == (None, "UNKNOWN_PLACE")


def test_somebody_elses_map_is_none(
    owner: Somebody, guest: Somebody, map_id: str, message: Message
) -> None:
    owner.post(HISTORY, json=message())
    assert guest.post(HISTORY, json=message()).status_code == 404
    for path in (live_of(map_id), f"{live_of(map_id)}/stream", f"{live_of(map_id)}/settings"):
        assert guest.get(path).status_code == 404
    assert guest.get(HISTORY).json() == []
    assert guest.get(f"/api/maps/{map_id}/webhooks").status_code == 404


def test_consent_that_ends_is_seen_at_once(owner: Somebody, map_id: str, message: Message) -> None:
    owner.post(HISTORY, json=message())
    owner.post(HISTORY, json=message(walk="9" * 16))
    over = {**message(is_over=True), "positions": []}
    assert owner.post(HISTORY, json=over).status_code == 204
    assert [each["walk"] for each in owner.get(live_of(map_id)).json()] == ["9" * 16]


def test_a_map_that_is_placed_tells_latitudes(
    owner: Somebody, map_id: str, message: Message
) -> None:
    settings = f"{live_of(map_id)}/settings"
    assert owner.get(settings).json() == {"is_on": True, "origin": None}
    origin = {"latitude_deg": 47.3769, "longitude_deg": 8.5417, "bearing_deg": 90.0}
    assert owner.put(settings, json={"is_on": True, "origin": origin}).json()["origin"] == origin
    assert owner.get(settings).json()["origin"] == origin
    owner.post(HISTORY, json=message(x_m=0.0, y_m=0.0))
    [live] = owner.get(live_of(map_id)).json()
    assert (live["latitude_deg"], live["longitude_deg"]) == (47.3769, 8.5417)
    assert owner.put(settings, json={}).json() == {"is_on": True, "origin": None}


def test_a_map_may_take_none(owner: Somebody, map_id: str, message: Message) -> None:
    owner.post(HISTORY, json=message())
    owner.put(f"{live_of(map_id)}/settings", json={"is_on": False})
    assert owner.get(live_of(map_id)).json() == []
    assert owner.get(f"{live_of(map_id)}/stream").status_code == 409
    refused = owner.post(HISTORY, json=message())
    assert refused.status_code == 409
    assert "switched live positions off" in refused.json()["detail"]


def test_in_a_published_floor_everybody_is_located_and_the_owner_sees(
    owner: Somebody, guest: Somebody, services: Services, message: Message
) -> None:
    publish_floor(services)
    assert guest.post(HISTORY, json=message(map=FLOOR)).status_code == 204
    assert [each["name"] for each in owner.get(live_of(FLOOR)).json()] == ["guest"]
    assert guest.get(live_of(FLOOR)).status_code == 404
    assert [each["map"] for each in guest.get(HISTORY).json()] == [FLOOR]


def test_haste_and_size_are_bounded(
    owner: Somebody, services: Services, message: Message, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(services.positions.rates, "_clock", lambda: 0.0)
    many = {**message(), "positions": 21 * message()["positions"]}
    assert owner.post(HISTORY, json=many).status_code == 422
    for wrong in ({"walk": "no hex"}, {"map": "short"}, {"map": "0" * 32}):
        assert owner.post(HISTORY, json=message(**wrong)).status_code in (404, 422)
    limits = services.settings.limits
    room = int(limits.position_requests_per_s * limits.burst_s)
    answers = [owner.post(HISTORY, json=message()).status_code for _ in range(room + 5)]
    assert set(answers) == {204, 429}
    assert owner.get("/api/me").status_code == 200


def test_history_comes_the_latest_first_and_page_by_page(
    owner: Somebody, map_id: str, message: Message, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(routes, "MOST_TOLD", 2)
    for k in range(3):
        owner.post(HISTORY, json=message(x_m=float(k), age_s=30.0 - k))
    first = owner.get(HISTORY).json()
    assert [each["x_m"] for each in first] == [2.0, 1.0]
    rest = owner.get(HISTORY, params={"before": first[-1]["time_utc"]}).json()
    assert [each["x_m"] for each in rest] == [0.0]
    assert owner.get(HISTORY, params={"map": "0" * 32}).json() == []
    assert len(owner.get(HISTORY, params={"map": map_id}).json()) == 2


def test_who_deletes_their_history_has_none_and_is_nowhere(
    owner: Somebody, guest: Somebody, services: Services, map_id: str, message: Message
) -> None:
    publish_floor(services)
    guest.post(HISTORY, json=message(map=FLOOR))
    owner.post(HISTORY, json=message())
    owner.get(HISTORY)
    owner.post(HISTORY, json=message())  # one is written, one waits
    waiting = services.positions.board.there(map_id)
    assert owner.delete(HISTORY).status_code == 204
    assert owner.get(HISTORY).json() == []
    assert owner.get(live_of(map_id)).json() == []
    assert services.positions.outboxes.wanted(waiting) == []
    assert len(guest.get(HISTORY).json()) == 1


def test_history_goes_with_its_walker_and_with_its_map(
    owner: Somebody, guest: Somebody, services: Services, map_id: str, message: Message
) -> None:
    publish_floor(services)
    guest.post(HISTORY, json=message(map=FLOOR))
    owner.post(HISTORY, json=message())
    assert kept(services) == 2
    guest.post(HISTORY, json=message(map=FLOOR))
    [theirs] = [each["id"] for each in owner.get("/api/users").json() if not each["is_owner"]]
    assert owner.delete(f"/api/users/{theirs}").status_code == 204
    assert owner.get(live_of(FLOOR)).json() == []
    assert kept(services) == 1
    owner.post(HISTORY, json=message())
    owner.put(f"{live_of(map_id)}/settings", json={"is_on": True})
    assert owner.delete(f"/api/maps/{map_id}").status_code == 204
    assert kept(services) == 0


def test_what_is_too_old_goes_with_the_sweep_and_at_a_start(
    owner: Somebody, services: Services, map_id: str
) -> None:
    me = owner.id
    days = services.settings.limits.position_days
    for age_days in (days + 0.01, days - 0.01, -days - 0.01):
        at_utc = now_utc() - timedelta(days=age_days)
        services.positions.history.add([position(map=map_id, walker=me, time_utc=at_utc)])
    assert kept(services) == 3
    assert len(owner.get(HISTORY).json()) == 2
    forget_old_positions(services)
    assert kept(services) == 1
    old = position(map=map_id, walker=me, time_utc=now_utc() - timedelta(days=days + 1))
    services.positions.history.add([old])
    assert kept(services) == 2
    with sweeping(services):
        assert kept(services) == 1


def test_history_is_written_by_itself(owner: Somebody, map_id: str, message: Message) -> None:
    owner.post(HISTORY, json=message())
    until(lambda: written(owner.services) == 1, "the history")


def test_a_database_that_is_away_is_said_once(
    services: Services, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def away(_services: Services) -> int:
        raise OperationalError("INSERT", {}, Exception("no answer"))

    with monkeypatch.context() as patched:
        patched.setattr(routes, "write_history", away)
        assert routes._write_or_say(services, is_away=False)
        assert routes._write_or_say(services, is_away=True)
    assert not routes._write_or_say(services, is_away=True)
    [line] = [record.message for record in caplog.records]
    assert "is not kept" in line


def test_what_could_not_be_written_is_written_later(
    owner: Somebody, services: Services, map_id: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    me = owner.id

    def away(*_: object) -> int:
        raise OperationalError("INSERT", {}, Exception("no answer"))

    with monkeypatch.context() as patched:
        patched.setattr(routes, "_written", away)
        services.positions.history.add([position(map=map_id, walker=me)])
        with pytest.raises(OperationalError):
            write_history(services)
    assert kept(services) == 1


def test_without_days_no_history_is_kept(owner: Somebody, map_id: str, message: Message) -> None:
    allow(owner.services, position_days=0.0)
    assert owner.post(HISTORY, json=message()).status_code == 204
    assert len(owner.get(live_of(map_id)).json()) == 1
    assert owner.get(HISTORY).json() == []
    assert kept(owner.services) == 0


def test_what_cannot_be_written_waits_and_the_oldest_gives_way(
    owner: Somebody, services: Services
) -> None:
    buffer = HistoryBuffer(most=3)
    buffer.add([position(x_m=0.0), position(x_m=1.0)])
    taken = buffer.take()
    buffer.add([position(x_m=2.0), position(x_m=3.0)])
    buffer.put_back(taken)
    assert [each.x_m for each in buffer.take()] == [1.0, 2.0, 3.0]
    assert buffer.take() == []
    delete_history(services, "0" * 32)


URL = "https://hooks.example.org/positions?key=1"


@pytest.fixture(autouse=True)
def found(monkeypatch: pytest.MonkeyPatch) -> None:
    """Names lead to addresses that are planted here."""
    known = {"hooks.example.org": ["93.184.216.34"], "inside.example.org": ["10.0.0.7"]}
    known["127.0.0.1"] = ["127.0.0.1"]

    def resolve(host: str, port: int) -> list[str]:
        if host not in known:
            raise OSError(8, "Name or service not known")
        return known[host]

    monkeypatch.setattr("elfslam.serve.positions.webhooks.resolved", resolve)


def hooks_of(map_id: str) -> str:
    return f"/api/maps/{map_id}/webhooks"


def test_a_webhook_is_told_its_secret_once(owner: Somebody, map_id: str) -> None:
    made = owner.post(hooks_of(map_id), json={"url": URL})
    assert made.status_code == 201
    assert len(made.json()["secret"]) >= 32
    given = owner.post(hooks_of(map_id), json={"url": URL, "secret": "s" * 16}).json()
    assert given["secret"] == "s" * 16
    told = owner.get(hooks_of(map_id)).json()
    assert {each["id"] for each in told} == {made.json()["id"], given["id"]}
    assert {each["url"] for each in told} == {URL}
    assert [(each["delivered"], each["dropped"], each["last_error"]) for each in told] == 2 * [
        (0, 0, None)
    ]
    assert not any("secret" in each for each in told)


def test_a_webhook_is_deleted_by_its_map_alone(owner: Somebody, map_id: str) -> None:
    made = owner.post(hooks_of(map_id), json={"url": URL}).json()
    assert owner.delete(f"{hooks_of('0' * 32)}/{made['id']}").status_code == 404
    assert owner.delete(f"{hooks_of(map_id)}/{'0' * 32}").status_code == 404
    assert owner.delete(f"{hooks_of(map_id)}/{made['id']}").status_code == 204
    assert owner.get(hooks_of(map_id)).json() == []


def test_webhooks_are_few(owner: Somebody, services: Services, map_id: str) -> None:
    most = services.settings.limits.webhooks
    answers = [owner.post(hooks_of(map_id), json={"url": URL}).status_code for _ in range(most + 1)]
    assert answers == most * [201] + [409]


@pytest.mark.parametrize(
    ("url", "line"),
    [
        ("ftp://hooks.example.org/", "wanted http"),
        ("https://me:word@hooks.example.org/", "without a user"),
        ("https://127.0.0.1/", "not public"),
        ("http://inside.example.org/", "leads to 10.0.0.7"),
        ("http://nobody.example.org/", "is not found"),
    ],
)
def test_where_a_webhook_may_not_lead_is_said(
    owner: Somebody, map_id: str, url: str, line: str
) -> None:
    refused = owner.post(hooks_of(map_id), json={"url": url})
    assert refused.status_code == 422
    assert line in refused.json()["detail"]
    assert owner.get(hooks_of(map_id)).json() == []


def test_a_short_secret_is_refused(owner: Somebody, map_id: str) -> None:
    assert owner.post(hooks_of(map_id), json={"url": URL, "secret": "short"}).status_code == 422


def test_local_webhooks_may_lead_inside(owner: Somebody, services: Services, map_id: str) -> None:
    object.__setattr__(services.settings, "local_webhooks", True)
    answer = owner.post(hooks_of(map_id), json={"url": "http://inside.example.org/"})
    assert answer.status_code == 201
