"""Live in a real browser: a robot's clouds through real zenoh, as they come."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import httpx
import pytest
import zenoh

from service.clouds import write_ply
from service.keys import KeyStore
from service.live import Shown
from service.streams import Stream
from service.transports.zenoh.replicas import name_of
from service.transports.zenoh.showing import SHOWN, pack
from tests.acceptance.browsing import DESKTOP, PHONE, Visit, colours, picture
from tests.acceptance.jobs_place import Place, free_port
from tests.acceptance.page.visiting import CLOUD, Visiting
from tests.learnt import learnt, objects
from tests.service.tabletop.seen import set_table
from tests.service.transports.zenoh.conftest import put
from tests.service.transports.zenoh.router import free_endpoint, session
from tests.service.transports.zenoh.test_answering import numbered

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

pytestmark = pytest.mark.slow
STREAMS = [{"key": "robots/*/cloud"}, {"key": "tables/*", "scene": True}]


class Site:
    """A service that answers streams, and where it is found."""

    def __init__(self, folder: Path, **given: object) -> None:
        self.endpoint = free_endpoint()
        self.place = Place(folder, zenoh_listen=self.endpoint, streams=json.dumps(STREAMS), **given)
        self.place.store.publish(learnt(), name="toys", seed=5, source={})
        self.port = free_port()
        self.host = f"http://127.0.0.1:{self.port}"

    @contextmanager
    def robot(self) -> Iterator[zenoh.Session]:
        with session(connect=self.endpoint) as robot:
            time.sleep(0.3)  # until it knows who listens
            yield robot


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    site = Site(tmp_path_factory.mktemp("site"))
    with site.place.api(site.port):
        yield site


@pytest.fixture
def robot(site: Site) -> Iterator[zenoh.Session]:
    with site.robot() as robot:
        yield robot


@pytest.fixture(scope="module")
def host(site: Site) -> str:
    return site.host


@contextmanager
def publishing(robot: zenoh.Session, *what: tuple[str, bytes], rate: float = 5.0) -> Iterator[None]:
    """A robot that publishes clouds over and over, so many of each a second."""
    end = threading.Event()

    def publish() -> None:
        number = 0
        while not end.wait(1 / rate):
            number += 1
            for key, payload in what:
                put(robot, key, payload, attachment=numbered(number, time.time_ns()))

    thread = threading.Thread(target=publish)
    thread.start()
    try:
        yield
    finally:
        end.set()
        thread.join()


def ply(number: int) -> bytes:
    return write_ply(objects()[number].cloud)


def live(page: Page) -> None:
    """Waits until the page is connected."""
    page.locator(".live-head [role=status]", has_text="live").wait_for()


def best_of(site: Site, cloud: bytes) -> str:
    """What the service says without a browser."""
    answer = httpx.post(f"{site.host}/v1/responses?model=toys", content=cloud, timeout=60).json()
    best = answer["concepts"][0]
    return str(best["name"] or f"Concept {best['id']}")


def test_a_cloud_is_shown_by_segment_with_its_concepts_rate_and_latency(
    visit: Visiting, site: Site, robot: zenoh.Session
) -> None:
    visited = visit("#/live")
    page = visited.page
    page.get_by_text("Nothing has come yet").wait_for()
    live(page)
    with publishing(robot, ("robots/7/cloud", ply(0))):
        page.locator(".robots .key", has_text="robots/7/cloud").wait_for()
        page.locator(".robots", has_text="a second").wait_for()
        page.locator(".robots", has_text=" ms").wait_for()
        page.wait_for_timeout(500)
    assert page.locator(".rank-name").first.inner_text() == best_of(site, ply(0))
    assert page.locator(".robots .said").inner_text() == best_of(site, ply(0))
    assert "key=robots/7/cloud" in page.url.replace("%2F", "/")
    assert colours(page, CLOUD) > 50
    answer = httpx.post(f"{site.host}/v1/responses?model=toys", content=ply(0), timeout=60).json()
    assert f"{answer['segments']} segments" in page.locator(".live-answer").inner_text()
    rate = float(page.locator(".robots .number").first.inner_text().split()[0])
    assert 1 < rate < 10
    page.locator(".live-answer .thumbnail:not(.missing)").first.wait_for()
    assert page.get_by_text("Nothing has come yet").count() == 0
    visited.check()


def test_of_several_robots_one_is_looked_at_and_the_url_says_which(
    visit: Visiting, site: Site, robot: zenoh.Session
) -> None:
    visited = visit("#/live")
    page = visited.page
    live(page)
    clouds = [("robots/7/cloud", ply(0)), ("robots/8/cloud", ply(1)), ("robots/9/cloud", b"torn")]
    with publishing(robot, *clouds):
        page.locator(".robots li").nth(2).wait_for()
        keys = page.locator(".robots .key").all_inner_texts()
        assert keys == [key for key, _ in clouds]
        page.get_by_role("button", name="robots/8/cloud").focus()
        page.keyboard.press("Enter")
        page.locator(".live-answer h2", has_text="robots/8/cloud").wait_for()
        page.locator(".live-cloud .fine", has_text="points").wait_for()
        page.wait_for_timeout(800)
        assert page.locator(".rank-name").first.inner_text() == best_of(site, ply(1))
        assert page.locator('.robots [aria-current="true"] .key').inner_text() == "robots/8/cloud"
        eighth = picture(page, CLOUD)
        page.get_by_role("button", name="robots/9/cloud").click()
        page.locator(".live-answer .title", has_text="not supported").wait_for()
        page.go_back()
        page.locator(".live-answer h2", has_text="robots/8/cloud").wait_for()
        shared = visited.again(page.url)
        shared.locator(".live-answer h2", has_text="robots/8/cloud").wait_for()
        shared.locator(".live-cloud .fine", has_text="points").wait_for()
        shared.wait_for_timeout(800)
        assert picture(shared, CLOUD) == eighth
    visited.check()


def test_the_objects_of_a_scene_are_marked_and_one_stream_is_chosen(
    visit: Visiting, site: Site, robot: zenoh.Session
) -> None:
    visited = visit("#/live")
    page = visited.page
    live(page)
    scene = write_ply(set_table("kinect").cloud)
    with publishing(robot, ("robots/7/cloud", ply(0)), ("tables/1", scene), rate=2):
        page.locator(".robots li").nth(1).wait_for()
        page.get_by_label("Stream", exact=True).select_option("tables/*")
        page.locator(".live-answer h2", has_text="tables/1").wait_for()
        page.locator(".cloud-marks .mark").first.wait_for()
        page.wait_for_timeout(1000)
        assert page.locator(".robots .key").all_inner_texts() == ["tables/1"]
    answer = httpx.post(f"{site.host}/v1/responses?model=toys&scene=true", content=scene, timeout=60).json()
    count = len(answer["objects"])
    assert page.locator(".cloud-marks .mark").all_inner_texts() == [str(number) for number in range(count)]
    assert page.locator(".live-answer tbody tr").count() == count
    visited.check()


def test_of_a_key_in_the_url_on_which_nothing_comes_this_is_told(
    visit: Visiting, site: Site, robot: zenoh.Session
) -> None:
    visited = visit("#/live?stream=no/such&key=robots/5/cloud")
    page = visited.page
    live(page)
    with publishing(robot, ("robots/7/cloud", ply(0))):
        page.locator(".robots .key", has_text="robots/7/cloud").wait_for()
        page.locator(".live-answer").get_by_text("Nothing has come on this key yet").wait_for()
        assert page.locator(".live-answer h2").inner_text() == "robots/5/cloud"
        assert page.locator(".live-answer .rank").first.is_hidden()
        page.locator(".robots button").click()
        page.locator(".live-answer h2", has_text="robots/7/cloud").wait_for()
        page.locator(".live-answer .rank").first.wait_for()
    visited.check()


def test_what_cannot_be_shown_keeps_nobody_from_what_can(visit: Visiting, site: Site, robot: zenoh.Session) -> None:
    visited = visit("#/live")
    page = visited.page
    live(page)
    streams: list[str] = []
    page.on("request", lambda request: streams.append(request.url))
    stream = Stream(key="robots/*/cloud")
    strange = Shown(stream.key, "robots/1/cloud", 1e9, {"of": "another release"}, problem=False, cloud=None)
    put(robot, f"{SHOWN}/{name_of(stream)}/elsewhere", pack(strange))
    page.get_by_role("alert").get_by_text("The page failed").wait_for()
    with publishing(robot, ("robots/7/cloud", ply(0))):
        page.locator(".robots .key", has_text="robots/7/cloud").wait_for()
    live(page)
    assert not [url for url in streams if "streams/events" in url and "key=" not in url]  # it has not begun anew
    assert len(visited.complaints) == 1


def test_while_it_is_paused_nothing_changes_and_nobody_works_for_it(
    visit: Visiting, site: Site, robot: zenoh.Session
) -> None:
    page = visit("#/live").page
    live(page)
    with publishing(robot, ("robots/7/cloud", ply(0))):
        page.locator(".robots .key").wait_for()
        page.get_by_role("button", name="Pause").click()
        page.locator(".live-head [role=status]", has_text="paused").wait_for()
        facts = page.locator(".live-answer .fine.number").last
        before = facts.inner_text()
        page.wait_for_timeout(1000)
        assert facts.inner_text() == before
        page.get_by_role("button", name="Go on").click()
        live(page)
        page.wait_for_timeout(1000)
        assert facts.inner_text() != before


def test_a_lost_connection_is_told_and_found_again(browser: Browser, tmp_path: Path) -> None:
    site = Site(tmp_path)
    visited = Visit(browser, site.host)
    with site.place.api(site.port), site.robot() as robot:
        page = visited.open("#/live")
        live(page)
        with publishing(robot, ("robots/7/cloud", ply(0))):
            page.locator(".robots .key").wait_for()
    page.get_by_text("connection lost").wait_for()
    page.get_by_text("silent for").wait_for()
    with site.place.api(site.port), site.robot() as robot:
        live(page)
        with publishing(robot, ("robots/8/cloud", ply(1))):
            page.locator(".robots .key", has_text="robots/8/cloud").wait_for()
    assert visited.complaints == []
    visited.close()


def test_a_connection_on_which_not_even_silence_is_told_is_made_anew(visit: Visiting) -> None:
    visited = visit("#/try")
    page = visited.page
    page.clock.install()
    page.locator("nav a", has_text="Live").click()
    live(page)
    with page.expect_request("**/v1/streams/events*"):
        page.clock.fast_forward(60_000)  # the browser believes that a minute has passed
    live(page)
    visited.check()


def test_why_there_is_nothing_to_watch_is_told(browser: Browser, tmp_path: Path) -> None:
    site = Site(tmp_path, access="keys")
    keys = KeyStore(site.place.store.url)
    training, answering = (keys.create(scope, (scope,)).text for scope in ("train", "answer"))
    silent = Place(tmp_path / "silent")
    silent.store.publish(learnt(), name="toys", seed=5, source={})
    port = free_port()
    with site.place.api(site.port), silent.api(port):
        visited = Visit(browser, site.host)
        page = visited.open("#/live")
        for text, told in ((None, "An access key is needed"), (training, "does not allow this"), (answering, None)):
            if text is not None:
                page.get_by_role("button", name="Access key", exact=True).click()
                page.get_by_role("dialog").get_by_label("Key", exact=True).fill(text)
                page.get_by_role("button", name="Use it").click()
            if told is not None:
                page.get_by_role("alert").get_by_text(told).first.wait_for()
        live(page)
        assert visited.complaints == []
        visited.close()
        without = Visit(browser, f"http://127.0.0.1:{port}")
        without.open("#/live").get_by_text("SHAPE_CONCEPTS_STREAMS").wait_for()
        without.check()
        without.close()


@pytest.mark.parametrize("size", [PHONE, DESKTOP])
def test_nothing_is_wider_than_the_screen(
    visit: Visiting, site: Site, robot: zenoh.Session, size: tuple[int, int]
) -> None:
    visited = visit("#/live", size, "dark")
    page = visited.page
    live(page)
    long = f"robots/{'long' * 30}/cloud"
    with publishing(robot, (long, ply(0)), ("robots/8/cloud", ply(1)), ("robots/9/cloud", ply(2))):
        page.locator(".robots li").nth(2).wait_for()
        page.wait_for_timeout(500)
    assert page.evaluate("document.documentElement.scrollWidth") <= size[0]
    visited.check()
