#!/usr/bin/env bash
# Installs the real programs that judge our files, and lists those that are missing in target/clients/missing, one on each line.
# On Debian 12 as root it installs all of them. A second run finds them installed.
set -euo pipefail
cd "$(dirname "$0")/.."
clients=target/clients
mkdir -p "$clients"
missing=()

say() { printf '\n== %s\n' "$*"; }
have() { command -v "$1" >/dev/null 2>&1; }

install_debian() {
    local wanted=()
    have blender || wanted+=(blender)
    have povray || wanted+=(povray)
    python3 -c 'import venv, ensurepip' >/dev/null 2>&1 || wanted+=(python3-venv)
    have python3 || wanted+=(python3 python3-venv)
    have node || wanted+=(nodejs)
    have npm || wanted+=(npm)
    # Blender's glTF importer needs numpy from the distribution's Python; bpy needs the X and GL libraries at load time, and Mesa's OpenGL on the
    # processor to render with EEVEE.
    dpkg -s python3-numpy >/dev/null 2>&1 || wanted+=(python3-numpy)
    for lib in libxkbcommon0 libxi6 libxfixes3 libxxf86vm1 libsm6 libgl1 libegl1 libegl-mesa0 libgl1-mesa-dri libxrender1; do
        dpkg -s "$lib" >/dev/null 2>&1 || wanted+=("$lib")
    done
    if [ ${#wanted[@]} -gt 0 ]; then
        say "installing ${wanted[*]}"
        apt-get update -qq
        DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "${wanted[@]}" >/dev/null
    fi
}

if [ -e /etc/debian_version ] && [ "$(id -u)" = 0 ] && have apt-get; then
    install_debian || missing+=("Debian packages")
fi
have blender || missing+=("blender (Debian's)")
have povray || missing+=("povray")

# bpy 5.0 is built for exactly one Python version.
python=$(command -v python3.11 || command -v python3 || true)
if [ -n "$python" ] && [ ! -e "$clients/venv/ready" ]; then
    say "installing bpy, usd-core and OpenEXR"
    if "$python" -m venv "$clients/venv" &&
        "$clients/venv/bin/pip" install -q --disable-pip-version-check -r tests/clients/requirements.txt; then
        touch "$clients/venv/ready"
    else
        rm -rf "$clients/venv"
    fi
fi
[ -e "$clients/venv/ready" ] || missing+=("bpy, usd-core, OpenEXR (PyPI)")

if [ -n "$python" ] && [ ! -x "$clients/tools/bin/maturin" ]; then
    say "installing maturin"
    "$python" -m venv "$clients/tools" && "$clients/tools/bin/pip" install -q --disable-pip-version-check maturin==1.16.0 || true
fi
[ -x "$clients/tools/bin/maturin" ] || have maturin || missing+=("maturin (PyPI)")

if have npm && [ ! -d "$clients/node_modules/gltf-validator" ]; then
    say "installing the Khronos glTF validator"
    npm install --silent --no-fund --no-audit --prefix "$clients" gltf-validator@2.0.0-dev.3.10 || true
fi
[ -d "$clients/node_modules/gltf-validator" ] || missing+=("gltf-validator (npm)")
if have npm && [ ! -d "$clients/node_modules/three" ]; then
    say "installing three.js"
    npm install --silent --no-fund --no-audit --prefix "$clients" three@0.170.0 || true
fi
[ -d "$clients/node_modules/three" ] || missing+=("three (npm)")

if have npm && [ ! -d "$clients/node_modules/@babylonjs/loaders" ]; then
    say "installing Babylon.js"
    npm install --silent --no-fund --no-audit --prefix "$clients" @babylonjs/core@7.54.3 @babylonjs/loaders@7.54.3 || true
fi
[ -d "$clients/node_modules/@babylonjs/loaders" ] || missing+=("Babylon.js (npm)")

printf '%s\n' ${missing[@]+"${missing[@]}"} >"$clients/missing"
