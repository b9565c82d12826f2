"""A browser without a window, and where its pictures are kept."""

import shutil
from pathlib import Path

import pytest

ARTEFACTS = Path(__file__).parents[1] / "artefacts"
FLAGS = (
    *("--headless=new", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"),
    *("--disable-background-networking", "--disable-component-update", "--disable-sync"),
    *("--disable-dev-shm-usage", "--hide-scrollbars"),
)


@pytest.fixture(scope="session")
def chromium(tmp_path_factory):
    """Chromium by Selenium, on a profile of its own."""
    webdriver = pytest.importorskip("selenium.webdriver", reason="pip install -e '.[test]'")
    browser = shutil.which("chromium") or shutil.which("google-chrome")
    driver = shutil.which("chromedriver")
    if browser is None or driver is None:
        pytest.skip(
            "no chromium and chromedriver on the PATH: apt install chromium chromium-driver"
        )
    options = webdriver.ChromeOptions()
    options.binary_location = browser
    for flag in (*FLAGS, f"--user-data-dir={tmp_path_factory.mktemp('chromium')}"):
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    started = webdriver.Chrome(options, webdriver.ChromeService(driver))
    started.set_script_timeout(60)
    yield started
    started.quit()


class Page:
    """A replay in the browser."""

    def __init__(self, driver):
        self.driver = driver

    def open(self, file, at="", size=(1440, 900), dark=False, still=False):
        """Show a page at a hash, in a window of a size."""
        media = [
            {"name": "prefers-color-scheme", "value": "dark" if dark else "light"},
            {"name": "prefers-reduced-motion", "value": "reduce" if still else "no-preference"},
        ]
        self.driver.get("about:blank")
        self.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": media})
        self.resize(*size)
        self.errors()
        self.driver.get(f"{file.resolve().as_uri()}{at}")
        assert (
            self.wait("window.replay ? replay.ready.then(() => 'ready') : 'no script'") == "ready"
        )
        return self

    def resize(self, width, height):
        metrics = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
        self.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)

    def run(self, script, *arguments):
        """The value of a script's return."""
        return self.driver.execute_script(script, *arguments)

    def wait(self, promise, *arguments):
        """The value a promise comes to."""
        return self.driver.execute_async_script(
            "const done = arguments[arguments.length - 1];"
            f"(async () => ({promise}))().then(done, (error) => done(String(error)));",
            *arguments,
        )

    def seek(self, episode, t_s, phase=None):
        self.wait("replay.seek(arguments[0], arguments[1], arguments[2])", episode, t_s, phase)
        return self.state()

    def state(self):
        return self.run("return replay.state()")

    def text(self, element):
        return self.run("return document.getElementById(arguments[0]).textContent", element)

    def click(self, element):
        self.run("document.getElementById(arguments[0]).click()", element)

    def key(self, key, shift=False):
        """Press a key, as a keyboard does."""
        from selenium.webdriver import ActionChains, Keys

        chain = ActionChains(self.driver)
        if shift:
            chain = chain.key_down(Keys.SHIFT).send_keys(key).key_up(Keys.SHIFT)
        else:
            chain = chain.send_keys(key)
        chain.perform()

    def point(self, what, click=False):
        """Move the pointer to a drone, user or station, and say where that is in the window."""
        from selenium.webdriver.common.action_chains import ActionChains

        self.frames(3)
        at = self.run("return replay.where(arguments[0])", what)
        pointer = ActionChains(self.driver, duration=0)
        pointer.w3c_actions.pointer_action.move_to_location(round(at["x"]), round(at["y"]))
        if click:
            pointer.w3c_actions.pointer_action.click()
        pointer.perform()
        self.frames(3)
        return at

    def frames(self, count=2):
        """Let so many frames be drawn."""
        self.wait(
            "new Promise((done) => { let left = arguments[0]; const next = () =>"
            " (left-- ? requestAnimationFrame(next) : done()); next(); })",
            count,
        )

    def picture(self, name):
        """Keep what is shown, as a PNG."""
        self.frames()
        ARTEFACTS.mkdir(exist_ok=True)
        self.driver.save_screenshot(str(ARTEFACTS / f"replay-{name}.png"))

    def errors(self):
        """What the console has complained of since it was asked last."""
        return [row["message"] for row in self.driver.get_log("browser")]


@pytest.fixture
def page(chromium):
    """A page that complains of nothing."""
    shown = Page(chromium)
    yield shown
    assert shown.errors() == []
