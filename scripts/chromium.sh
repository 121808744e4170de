#!/bin/sh
# Install Debian's Chromium and its driver, which the browser tests need, if they are not there.
# Where that cannot be done it says so, and the tests skip; an installation that fails is an error.
set -eu

say() { printf '%s\n' "$*" >&2; }
there() { command -v chromium >/dev/null && command -v chromedriver >/dev/null; }
without() {
    say "No Chromium: $1, so the browser tests will skip. With it: apt-get install chromium chromium-driver"
    exit 0
}

if there; then exit 0; fi
command -v apt-get >/dev/null || without "there is no apt-get here"
[ "$(id -u)" = 0 ] || without "only root may install it"
say "Installing Debian's Chromium (about 400 MB) ..."
export DEBIAN_FRONTEND=noninteractive
if ! { apt-get -qq -o Acquire::Retries=3 update &&
    apt-get -qq -o Acquire::Retries=3 install --yes --no-install-recommends chromium chromium-driver; } >&2
then
    say "apt-get could not install Chromium; what it says stands above."
    exit 1
fi
if ! there; then
    say "apt-get installed no chromium and chromedriver; the packages of Debian have them, those of Ubuntu do not."
    exit 1
fi
