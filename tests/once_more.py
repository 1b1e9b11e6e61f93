"""`pytest --once-more`: tests that waited in vain are run again at the end, each alone.

A busy machine makes waits too short; it makes no value wrong. So a test whose failures are all
exceptions of time is given one more chance, once all others have ended, and the summary says so.
One that failed by an assertion is not.
"""

import re
import subprocess
import sys
from dataclasses import dataclass, field

import pytest

WAITED = re.compile(r"[\w.]*Time(outError|out|outExpired)\b")
"""TimeoutError, of Python or Playwright; subprocess.TimeoutExpired; httpx.ReadTimeout."""


def add_option(parser: pytest.Parser) -> None:
    """The option that switches it on."""
    help_text = "run tests that waited in vain once more, alone, and say so"
    parser.addoption("--once-more", action="store_true", help=help_text)


def waited(report: pytest.TestReport) -> bool:
    """Whether a test, or what it needs, ended because something did not come in time."""
    crash = getattr(report.longrepr, "reprcrash", None)
    return crash is not None and WAITED.match(crash.message) is not None


@dataclass(eq=False)
class OnceMore:
    """Collects what failed, and runs at the end what only waited in vain."""

    failed: dict[str, list[bool]] = field(default_factory=dict)
    """By test, whether each of its failures was one of time."""
    errors: int = 0
    """Of collection."""
    outcomes: dict[str, bool] = field(default_factory=dict)
    """By test that was run again, whether it passed."""

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.failed:
            self.failed.setdefault(report.nodeid, []).append(waited(report))

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        self.errors += report.failed

    @pytest.hookimpl(trylast=True)
    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        for test, causes in self.failed.items():
            if all(causes):
                self.outcomes[test] = passes_alone(test, session.config)
        mended = all(self.outcomes.get(test, False) for test in self.failed)
        if session.exitstatus == pytest.ExitCode.TESTS_FAILED and mended and not self.errors:
            session.exitstatus = pytest.ExitCode.OK

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        if self.outcomes:
            terminalreporter.section("waited in vain, run once more, alone")
        for test, passed in self.outcomes.items():
            terminalreporter.write_line(f"{'passed' if passed else 'FAILED AGAIN'} {test}")


def passes_alone(test: str, config: pytest.Config) -> bool:
    """Run a test in a process of its own."""
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-n", "0", test]
    return subprocess.run(command, cwd=config.rootpath, check=False).returncode == 0
