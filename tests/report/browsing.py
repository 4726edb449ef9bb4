"""What tests do with a page in headless Chromium."""

import shutil

import pytest

CHROMIUM = shutil.which("chromium")
DRIVER = shutil.which("chromedriver")
NEEDS_BROWSER = [
    pytest.mark.slow,
    pytest.mark.skipif(
        not (CHROMIUM and DRIVER), reason="needs chromium and chromedriver"
    ),
]


def media(browser, scheme):
    features = [
        {"name": "prefers-color-scheme", "value": scheme},
        {"name": "prefers-reduced-motion", "value": "reduce"},  # scrolls at once
    ]
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": features})


def size(browser, width, height):
    metrics = {"width": width, "height": height, "deviceScaleFactor": 1}
    browser.execute_cdp_cmd(
        "Emulation.setDeviceMetricsOverride", metrics | {"mobile": width < 500}
    )


def ask(browser, expression, *arguments):
    """The value of an expression on the page; a promise is waited for."""
    return browser.execute_async_script(
        "const [done, args] = [arguments[arguments.length - 1], arguments];"
        f"Promise.resolve((async () => ({expression}))())"
        ".then(done, (error) => done(`error: ${error}`));",
        *arguments,
    )


def wait(browser, expression):
    from selenium.webdriver.support.ui import WebDriverWait

    WebDriverWait(browser, 20, 0.05).until(lambda _: ask(browser, expression))


def element(browser, identifier):
    return browser.find_element("id", identifier)


def choose(browser, identifier, value):
    from selenium.webdriver.support.ui import Select

    Select(element(browser, identifier)).select_by_value(str(value))
