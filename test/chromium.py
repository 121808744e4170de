"""Debian's Chromium, without a screen, for tests of the page."""

import json
import shutil
import tempfile

import psutil
import pytest

CHROMIUM, DRIVER = shutil.which("chromium"), shutil.which("chromedriver")
LACKING = "" if CHROMIUM and DRIVER else "no Chromium: apt-get install chromium chromium-driver"
FLAGS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync",
    "--disable-dev-shm-usage",  # a container's is small, and ROS 2 wants it
)  # fmt: skip
KEYS = {"ArrowLeft": 37, "ArrowUp": 38, "ArrowRight": 39, "ArrowDown": 40, " ": 32}
needs_chromium = pytest.mark.skipif(bool(LACKING), reason=LACKING)


class Browser:
    """A window of a Chromium of its own.

    Parameters
    ----------
    width, height : int
        Of the page [px].
    log : bool
        Whether to write down what it asks for; that costs time for each message of a socket.
    """

    def __init__(self, width=1280, height=800, log=False):
        from selenium import webdriver
        from selenium.webdriver.chrome.service import Service

        self._profile = tempfile.mkdtemp(prefix="iolspi-chromium-")
        options = webdriver.ChromeOptions()
        options.binary_location = CHROMIUM
        for flag in (*FLAGS, f"--user-data-dir={self._profile}"):
            options.add_argument(flag)
        kept = {"browser": "ALL"} | ({"performance": "ALL"} if log else {})
        options.set_capability("goog:loggingPrefs", kept)
        self.driver = webdriver.Chrome(options=options, service=Service(DRIVER))
        self.resize(width, height)

    def resize(self, width, height):
        metrics = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 600}
        self.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)

    def open(self, address):
        self.driver.get(address)

    def run(self, script):
        return self.driver.execute_script(script)

    def part(self, name):
        """The newest of a part that the socket sent."""
        return self.run(f"return window.cockpit ? window.cockpit.is[{name!r}] ?? null : null")

    def click(self, name):
        self.run(f"document.getElementById({name!r}).click()")

    def text(self, name):
        return self.run(f"return (document.getElementById({name!r}) || {{}}).textContent || ''")

    def _key(self, kind, key):
        code = KEYS.get(key) or ord(key.upper())
        self.driver.execute_cdp_cmd(
            "Input.dispatchKeyEvent",
            {"type": kind, "key": key, "windowsVirtualKeyCode": code},
        )

    def press(self, key):
        self._key("keyDown", key)

    def lift(self, key):
        self._key("keyUp", key)

    def set(self, slider, value):
        """Move a slider."""
        self.run(f"""
            const slider = document.getElementById({slider!r});
            slider.value = {value};
            slider.dispatchEvent(new Event("change"));
        """)

    def stop(self):
        """Let nothing of it run, as in a machine that is suspended."""
        for process in self._processes():
            process.suspend()

    def go_on(self):
        """After `stop`."""
        for process in self._processes():
            process.resume()

    def _processes(self):
        """Of the browser; its driver goes on."""
        return psutil.Process(self.driver.service.process.pid).children(recursive=True)

    def complaints(self):
        """What the page said to its console as an error."""
        return [line for line in self.driver.get_log("browser") if line["level"] == "SEVERE"]

    def requests(self):
        """Addresses of all that the page asked for, sockets among it."""
        found = set()
        for line in self.driver.get_log("performance"):
            message = json.loads(line["message"])["message"]
            if message["method"] == "Network.requestWillBeSent":
                found.add(message["params"]["request"]["url"])
            elif message["method"] == "Network.webSocketCreated":
                found.add(message["params"]["url"])
        return {url for url in found if not url.startswith(("chrome:", "data:", "about:", "blob:"))}

    def close(self):
        self.driver.quit()
        shutil.rmtree(self._profile, ignore_errors=True)
