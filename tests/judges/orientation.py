"""Which way round is it? Usage: orientation.py DIR, the result of a source with lobes at +X+Z (1) and at +Y+Z (1/2).

A mirrored file passes every check of flux. Radiance renders the file: it must find the peak at C0, gamma 45 and the second
lobe at C270 (for a +Z emitter C90 = -Y)."""

import sys
from pathlib import Path

import numpy as np

import radiance


def main(folder):
    ies = Path(folder) / "ies" / "total.ies"
    c, gamma = (angles.ravel() for angles in np.meshgrid(np.arange(0, 360, 5.0), np.arange(2.5, 90, 5.0)))
    candela = radiance.candela(ies, c, gamma)
    peak = int(np.argmax(candela))
    away = np.minimum(np.abs(c - c[peak]), 360 - np.abs(c - c[peak])) > 45
    second = int(np.argmax(np.where(away, candela, -1)))
    ratio = candela[second] / candela[peak]
    print(f"peak at C{c[peak]:.0f} gamma {gamma[peak]:.1f}, second at C{c[second]:.0f} gamma {gamma[second]:.1f}, ratio {ratio:.3f}")

    def near(at, c_deg):
        turn = abs(c[at] - c_deg)
        return min(turn, 360 - turn) <= 10 and abs(gamma[at] - 45) <= 7.5

    good = [near(peak, 0), near(second, 270), abs(ratio - 0.5) < 0.1]
    print(f"{len(good)} checks, {good.count(False)} failed ({len(candela)} directions traced)")
    return 0 if all(good) else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
