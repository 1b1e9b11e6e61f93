"""What the server is told when it starts: where its data lie, and what it allows."""

from dataclasses import dataclass, field
from pathlib import Path

from elfslam.serve.positions.mqtt import Broker

MEBIBYTE = 2**20
GIBIBYTE = 2**30
DATA_FOLDER = Path("~/.elfslam")
PORT = 8443
PAGES_FOLDER = Path(__file__).parent / "pages"
COOKIE = "elfslam_token"


@dataclass(frozen=True)
class Limits:
    """What one user, one recording, one file and one request may cost."""

    file_bytes: int = GIBIBYTE
    recording_bytes: int = 2 * GIBIBYTE
    user_bytes: int = 20 * GIBIBYTE
    request_bytes: int = MEBIBYTE
    """Of a request that is no upload."""
    floor_plan_bytes: int = 16 * MEBIBYTE
    free_bytes: int = 256 * MEBIBYTE
    """What an upload leaves free on the disk."""
    users: int = 100
    recordings: int = 2_000
    open_uploads: int = 200
    shares: int = 5_000
    """Of all maps of one user, with all people together."""
    jobs: int = 200
    """Queued or running, of one user."""
    token_requests_per_s: float = 30.0
    address_requests_per_s: float = 60.0
    burst_s: float = 10.0
    """That many seconds' worth of requests may come at once."""
    connections: int = 500
    address_connections: int = 60
    """At once; of one address, where no reverse proxy stands between."""
    head_s: float = 10.0
    """The head of a request has come by then, and so is a TLS handshake made."""
    silence_s: float = 20.0
    """So far a client may fall behind: with a body, silent or below the slowest pace, and with
    reading an answer. It is then cut; what came of an upload is kept."""
    slowest_bytes_per_s: float = 500.0
    """Of the body of a request."""
    upload_days: float = 14.0
    """An upload to which nothing was added for this long is deleted."""
    quarantine_days: float = 30.0
    """A file that no row names is set aside at a start, and deleted after this long."""
    position_days: float = 1.0
    """Positions that walkers told are deleted after this long; 0 keeps none."""
    position_requests_per_s: float = 4.0
    """In which one walker tells positions."""
    position_streams: int = 20
    """That one user listens to at once."""
    webhooks: int = 5
    """Of one map."""
    reading_s: float = 600.0
    reading_bytes: int = 6 * GIBIBYTE
    """Time and memory that reading one recording may take."""
    drawing_s: float = 20.0
    drawing_bytes: int = 320 * MEBIBYTE
    """Processor time and memory that drawing one floor plan may take."""
    job_s: float = 4 * 3600.0
    job_bytes: int = 8 * GIBIBYTE
    """Time and memory that one job may take; no file that it writes is larger either."""


@dataclass(frozen=True)
class ServerSettings:
    """What `elfslam serve` was told. Folders inside `data_folder` belong to the server."""

    data_folder: Path
    database_url: str = ""
    """SQLAlchemy's; by default SQLite in the data folder."""
    limits: Limits = field(default_factory=Limits)
    secure_cookie: bool = True
    """Off only where plain HTTP on loopback is spoken."""
    run_jobs: bool = True
    job_workers: int = 1
    """Jobs that are worked on at once, where `on` does not say."""
    on: str | None = None
    """Who works on jobs: a number of processes, `ray` or `ray://HOST:PORT`; this machine."""
    allow_public: bool = False
    """Answer also those who are neither on this machine nor in its local network."""
    names: tuple[str, ...] = ()
    """What else browsers may call this server, besides addresses and this machine's names."""
    pages_folder: Path = PAGES_FOLDER
    files_url: str = ""
    """fsspec's, of the parts of published floors; by default a folder in the data folder."""
    broker: Broker | None = None
    """Whom positions are published to by MQTT."""
    local_webhooks: bool = False
    """Post positions to this machine and its local networks, too."""

    @property
    def url(self) -> str:
        """Of the database."""
        return self.database_url or f"sqlite:///{self.data_folder / 'elfslam.sqlite'}"

    @property
    def files(self) -> str:
        """Where the parts of published floors lie, as a URL."""
        return self.files_url or (self.data_folder / "published").absolute().as_uri()

    @property
    def blobs_folder(self) -> Path:
        """Files by their SHA-256."""
        return self.data_folder / "blobs"

    @property
    def uploads_folder(self) -> Path:
        """Files on their way."""
        return self.data_folder / "uploads"

    @property
    def work_folder(self) -> Path:
        """Scratch, one folder per piece of work; emptied by whoever made it."""
        return self.data_folder / "work"

    @property
    def backups_folder(self) -> Path:
        """The database as it was before each upgrade."""
        return self.data_folder / "backups"

    @property
    def quarantine_folder(self) -> Path:
        """Files that no row named, until they are deleted."""
        return self.data_folder / "quarantine"

    @property
    def authority_folder(self) -> Path:
        """Keys and certificates, for their owner alone."""
        return self.data_folder / "authority"


def prepare_folders(settings: ServerSettings) -> None:
    """Make the folders of the server, closed to other users of the machine."""
    settings.data_folder.mkdir(parents=True, exist_ok=True, mode=0o700)
    for folder in (
        settings.blobs_folder,
        settings.uploads_folder,
        settings.work_folder,
        settings.authority_folder,
        settings.quarantine_folder,
    ):
        folder.mkdir(exist_ok=True, mode=0o700)
