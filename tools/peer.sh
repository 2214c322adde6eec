#!/usr/bin/env bash
# Build the robot that speaks another vendor's DDS, for the tests of ROS 2: tests/ros/peer.cpp.
# Without the vendor's library these tests say that they are left out, and why.
set -euo pipefail

packages=(g++ libfastrtps-dev libfastcdr-dev) # Fast DDS 2, as Debian 12 has it
tools/system.sh "${packages[@]}"
rm -rf .venv/fastdds
dpkg-query -W -f='${Status}\n' "${packages[@]}" 2>/dev/null | grep -c 'ok installed' |
  grep -qx "${#packages[@]}" || exit 0
mkdir .venv/fastdds
g++ -std=c++17 -Wall -Werror tests/ros/peer.cpp -o .venv/fastdds/peer -lfastrtps -lfastcdr -pthread
