# SPDX-License-Identifier: MIT
"""A headless Chromium driven over the W3C WebDriver protocol with nothing but the standard library.

    with Browser() as page:
        page.open("http://127.0.0.1:8080/")
        page.until("the title", lambda: page.text("#title") == "Place the board")
"""
import json, os, shutil, socket, subprocess, sys, tempfile, threading, urllib.error, urllib.request, base64

SKIPPED = 77  # ctest's SKIP_RETURN_CODE
# The key of an element reference in answers (https://www.w3.org/TR/webdriver2/#elements).
ELEMENT = "element-6066-11e4-a52e-4f735466cecf"
PATIENCE_S = 60
_tick = threading.Event()  # Never set: waiting for it is the pause between two looks.


def need(*programs):
    """Ends the test as skipped when a program that it drives is not installed."""
    missing = [program for program in programs if not shutil.which(program)]
    if missing:
        print("skipped: not installed: " + ", ".join(missing))
        sys.exit(SKIPPED)


def environment():
    """The environment without proxies: everything here is on the loopback interface."""
    return {name: value for name, value in os.environ.items() if not name.lower().endswith("_proxy")}


def until(what, look, patience_s=PATIENCE_S):
    """Looks until `look()` is true, and returns its value; an AssertionError that names `what` after `patience_s`."""
    for _ in range(int(patience_s * 20)):
        found = look()
        if found:
            return found
        _tick.wait(0.05)
    raise AssertionError(f"waited {patience_s} s in vain for {what}")


class Browser:
    def __init__(self, width=1280, height=960):
        need("chromium", "chromedriver")
        self.folder = tempfile.TemporaryDirectory(prefix="rig-browser-", ignore_cleanup_errors=True)
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        self.address = f"http://127.0.0.1:{port}"
        self.http = urllib.request.build_opener(urllib.request.ProxyHandler({}))
        self.driver = subprocess.Popen(["chromedriver", f"--port={port}"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
                                       env=environment())
        self.session = None
        try:
            until("chromedriver", self._ready)
            flags = ["--headless=new", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync",
                     "--disable-background-networking", "--disable-component-update", "--disable-dev-shm-usage", "--no-proxy-server",
                     f"--user-data-dir={self.folder.name}/profile", f"--window-size={width},{height}"]
            wanted = {"browserName": "chrome", "goog:loggingPrefs": {"browser": "ALL"}, "goog:chromeOptions": {"args": flags}}
            self.session = self._call("POST", "/session", {"capabilities": {"alwaysMatch": wanted}})["sessionId"]
        except BaseException:
            self.close()
            raise

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def close(self):
        if self.session:
            try:
                self._call("DELETE", f"/session/{self.session}")
            except (AssertionError, OSError):
                pass
        self.driver.kill()
        self.driver.wait()
        self.folder.cleanup()

    def _ready(self):
        try:
            return self._call("GET", "/status")["ready"]
        except OSError:
            return False

    def _call(self, method, path, body=None):
        data = json.dumps(body if body is not None else {}).encode() if method == "POST" else None
        request = urllib.request.Request(self.address + path, data, {"Content-Type": "application/json"}, method=method)
        try:
            with self.http.open(request, timeout=PATIENCE_S) as answer:
                return json.loads(answer.read())["value"]
        except urllib.error.HTTPError as refused:
            raise AssertionError(f"{method} {path}: {refused.read().decode(errors='replace')[:400]}") from None

    def _do(self, method, path, body=None):
        return self._call(method, f"/session/{self.session}{path}", body)

    def open(self, url):
        self._do("POST", "/url", {"url": url})

    def run(self, script, *arguments):
        """The value that the script returns in the page."""
        return self._do("POST", "/execute/sync", {"script": script, "args": list(arguments)})

    def text(self, selector):
        return self.run("const e = document.querySelector(arguments[0]); return e ? e.innerText : null;", selector)

    def click(self, selector):
        """A click where a hand would put it: refused when something covers the element."""
        element = self._do("POST", "/element", {"using": "css selector", "value": selector})[ELEMENT]
        self._do("POST", f"/element/{element}/click")

    def type(self, selector, keys):
        element = self._do("POST", "/element", {"using": "css selector", "value": selector})[ELEMENT]
        self._do("POST", f"/element/{element}/value", {"text": keys})

    def accept_dialog(self):
        """Answers a confirm() with yes and returns its text."""
        text = self._do("GET", "/alert/text")
        self._do("POST", "/alert/accept")
        return text

    def errors(self):
        """What the page's console complained of since the last call."""
        return [entry["message"] for entry in self._do("POST", "/se/log", {"type": "browser"}) if entry["level"] == "SEVERE"]

    def picture(self, path):
        """The window as a PNG file."""
        with open(path, "wb") as out:
            out.write(base64.b64decode(self._do("GET", "/screenshot")))
