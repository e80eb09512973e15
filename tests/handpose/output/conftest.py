"""The browser fixtures, for the hand page and the live page."""

from tests.support.chromium_tabs import browser, visit

__all__ = ["browser", "visit"]
