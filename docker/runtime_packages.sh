#!/usr/bin/env bash
# Prints the Debian packages that hold the shared libraries of the given programs, so that an image
# for running them needs nothing else.
set -euo pipefail

ldd "$@" | awk '$2 == "=>" && $3 ~ "^/" { print $3 }' | sort -u | while read -r library; do
  # /lib is a link to /usr/lib, and dpkg knows a file by one of the two names only.
  real=$(realpath "$library")
  { dpkg -S "$real" || dpkg -S "${real#/usr}"; } 2>/dev/null | head -n 1 | cut -d: -f1
done | sort -u
