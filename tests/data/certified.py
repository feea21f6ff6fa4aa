"""Makes certified.json: numbers by other people's programs, which examples/certified holds ours against.

    python3 -m venv venv
    venv/bin/pip install numpy==2.4.6 scipy==1.17.1 PythonicDISORT==1.8 iadpython==0.5.3 miepython==3.3.0
    venv/bin/python tests/data/certified.py

Slabs and half spaces: discrete ordinates (PythonicDISORT, after Stamnes et al. 1988), and adding-doubling of Prahl's program (iadpython) where the
index is not 1. Spheres: a Monte Carlo walk of a few lines. Fluence: Fourier inversion by scipy. Droplets: Mie's theory (miepython).
Takes half a minute.
"""

import json
import os
import re
from pathlib import Path

os.environ["MIEPYTHON_USE_JIT"] = "1"

import iadpython
import miepython
import numpy as np
from PythonicDISORT import subroutines
from PythonicDISORT.pydisort import pydisort
from scipy.integrate import quad
from scipy.interpolate import CubicSpline

STREAMS = 64
found = {"made by": "certified.py with PythonicDISORT 1.8, iadpython 0.5.3, miepython 3.3.0, numpy 2.4.6 and scipy 1.17.1"}


def number(x):
    return float(f"{float(x):.7g}")


def disort(tau, albedo, moments, ground=0.0):
    """R, T and radiances of a slab for beams at cosines 1 and 0.5, by what they are called in certified.json."""
    # Lossless slabs are not allowed; what this absorbs is less than 1e-6 but in the thickest.
    albedo = min(albedo, 1 - 1e-9)
    moments = np.asarray(moments)[None, : 3 * STREAMS]
    bdrf = [ground] if ground > 0 else []
    values = {}
    for mu0, name in ((1.0, "0"), (0.5, "60")):
        mu, up, down, mode, *_ = pydisort(
            np.array([tau]), np.array([albedo]), STREAMS, moments, mu0, 1.0, 0.0,
            NLeg=STREAMS, NFourier=1, f_arr=moments[0, STREAMS], BDRF_Fourier_modes=bdrf,
        )
        values["r" + name] = up(0) / mu0
        values["t" + name] = sum(down(tau)) / mu0
        if mu0 == 0.5:
            # At the normal, by the polynomial through the nodes of one hemisphere.
            half = STREAMS // 2
            radiance = lambda tau, side: barycentric(mu[side], mode(tau)[side], np.sign(mu[side][0]))
            values["up"] = radiance(0, slice(0, half))
            values["down"] = radiance(tau, slice(half, None))
    return values


def barycentric(x, y, at):
    x, y = np.asarray(x), np.asarray(y)
    span = 4 / (x.max() - x.min())
    weights = np.array([1 / np.prod(span * (x[i] - np.delete(x, i))) for i in range(len(x))])
    terms = weights / (at - x)
    return (terms @ y) / terms.sum()


def emit(table, key, values):
    found.setdefault(table, {})[key] = {name: number(value) for name, value in values.items()}


def hg(g):
    return g ** np.arange(3 * STREAMS, dtype=float)


# Slabs.
for tau, albedo, g in [
    (0.1, 0.9, 0), (0.1, 1, 0.75), (1, 0.5, 0), (1, 0.9, 0.75), (1, 1, 0), (1, 0.99, 0.9), (2, 0.9, 0.75), (10, 0.9, 0),
    (10, 0.5, 0.75), (10, 0.99, 0.9), (10, 1, 0.75), (100, 0.99, 0), (100, 1, 0.9),
]:
    emit("slab", f"1 {tau:g} {albedo:g} {g:g}", disort(tau, albedo, hg(g)))
for index, tau, albedo, g in [(1.4, 1, 0.9, 0.75), (1.4, 10, 0.99, 0), (1.5, 30, 0.9, 0)]:
    # Beams at an angle it does not know.
    r, t, _, _ = iadpython.Sample(a=albedo, b=tau, g=g, n=index, n_above=1, n_below=1, quad_pts=32).rt()
    emit("slab", f"{index:g} {tau:g} {albedo:g} {g:g}", {"r0": r, "t0": t})

# Half spaces: thick slabs, the lossless one on a white ground.
for albedo, tau, ground in ((0.5, 30, 0), (0.9, 60, 0), (0.99, 120, 0), (1, 30, 1)):
    emit("half_space", f"{albedo:g}", disort(tau, albedo, hg(0), ground))

# Clouds.
for tau in (8, 64):
    for ground in (0, 0.8):
        emit("cloud", f"{tau} hg {ground:g}", disort(tau, 1, hg(0.85), ground))


# Spheres: shares of light from all sides that leave again, by walks with roulette by albedo.
def sphere(albedo, radius, count=4_000_000, seed=1):
    rng = np.random.default_rng(seed)
    # On the sphere, at its north pole, in a direction drawn by the cosine.
    sin2 = rng.random(count)
    turn = 2 * np.pi * rng.random(count)
    direction = np.stack([np.sqrt(sin2) * np.cos(turn), np.sqrt(sin2) * np.sin(turn), -np.sqrt(1 - sin2)], axis=1)
    place = np.tile([0.0, 0.0, radius], (count, 1))
    escaped = 0
    while len(place):
        place = place + direction * rng.exponential(size=(len(place), 1))
        inside = (place * place).sum(axis=1) < radius * radius
        escaped += np.count_nonzero(~inside)
        place = place[inside & (rng.random(len(place)) < albedo)]
        z = 2 * rng.random(len(place)) - 1
        turn = 2 * np.pi * rng.random(len(place))
        s = np.sqrt(1 - z * z)
        direction = np.stack([s * np.cos(turn), s * np.sin(turn), z], axis=1)
    share = escaped / count
    return {"albedo": share, "error": np.sqrt(share * (1 - share) / count)}


for albedo, radius in ((0.9, 0.1), (0.5, 1), (0.9, 1), (0.99, 1), (0.9, 10), (0.99, 10)):
    emit("sphere", f"{albedo:g} {radius:g}", sphere(albedo, radius))


# An endless medium: what parallel rays see that start on a square of half width d/4 at the distance d from an isotropic source of power 1.
def fluence(albedo, r):
    # Light that was not scattered, and twice and more; light scattered once by its own integral over lines.
    atan = lambda k: np.arctan(k) / k if k > 0 else 1.0
    once_more = lambda k: k * albedo**2 * atan(k) ** 3 / (1 - albedo * atan(k))
    twice, _ = quad(once_more, 0, np.inf, weight="sin", wvar=r, limlst=200, epsabs=1e-14)
    # ∫ e^(−a−b)/(4π)² a² b² over all space, in spheroidal coordinates: 1/(4πr) ∫₁^∞ e^(−rξ)/ξ ln((ξ + 1)/(ξ − 1)) dξ, ξ = 1 + v².
    shell = lambda v: np.exp(-r * (1 + v * v)) / (1 + v * v) * np.log((2 + v * v) / (v * v)) * 2 * v if v > 0 else 0.0
    once, _ = quad(shell, 0, np.inf)
    return np.exp(-r) / (4 * np.pi * r * r) + albedo * once / (4 * np.pi * r) + twice / (2 * np.pi**2 * r)


def seen(albedo, d):
    # What is farther adds less than 1e-6.
    r = np.geomspace(d, 17 + 1.2 * d, 60)
    spline = CubicSpline(np.log(r), np.log([x * x * fluence(albedo, x) for x in r]))
    value = lambda x: np.exp(spline(np.log(x))) / (x * x)
    x, w = np.polynomial.legendre.leggauss(24)
    x, w = (x + 1) / 2, w / 2
    half = d / 4
    across = np.hypot(half * x[:, None], half * x[None, :])
    total = 0.0
    for a, b in ((0, 1), (1, 4), (4, 9), (9, 16)):
        t = a + (b - a) * x
        total += np.einsum("i,j,k,ijk->", w, w, w * (b - a) * np.exp(-t), value(np.hypot(across[..., None], d + t)))
    return {"radiance": total * albedo / (4 * np.pi)}


for albedo in (0.5, 0.9, 0.99):
    for d in (0.5, 1, 2, 5, 10):
        emit("endless", f"{albedo:g} {d:g}", seen(albedo, d))

# Water droplets at 550 nm, index 1.333, diameters spread log-normally by 10 %, weighted by what they scatter.
ANGLES = [0, 5, 10, 20, 40, 60, 90, 120, 140, 160, 180]
edges = 1 - np.array([0, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 0.1, 0.4, 1, 1.6, 1.9, 2])
x, w = np.polynomial.legendre.leggauss(96)
mu = np.concatenate([(a + b) / 2 + (b - a) / 2 * x for a, b in zip(edges, edges[1:])])
weight = np.concatenate([np.abs(b - a) / 2 * w for a, b in zip(edges, edges[1:])])
at = np.cos(np.radians(ANGLES))
for diameter in (10, 20):
    total, mean, some = 0.0, np.zeros_like(mu), np.zeros_like(at)
    for z in np.linspace(-3, 3, 241):
        d = diameter * np.exp(0.1 * z)
        _, scattering, _, _ = miepython.efficiencies(1.333, d, 0.55)
        share = np.exp(-z * z / 2) * d * d * float(np.squeeze(scattering))
        size = np.pi * d / 0.55
        total += share
        mean += share * np.squeeze(miepython.i_unpolarized(1.333, size, mu, norm="one"))
        some += share * np.squeeze(miepython.i_unpolarized(1.333, size, at, norm="one"))
    mean, some = mean / total, some / total
    polynomials = np.polynomial.legendre.legvander(mu, 3 * STREAMS)
    moments = 2 * np.pi * (weight * mean) @ polynomials
    print(f"{diameter} um: normalised to {moments[0]:.8f}, g = {moments[1]:.5f}")
    moments /= moments[0]
    values = {"angles": ANGLES, "values": [number(v) for v in some], "moments": [number(m) for m in moments[:81]]}
    values |= {str(tau): {name: number(value) for name, value in disort(tau, 1, moments).items()} for tau in (8, 64)}
    found.setdefault("droplets", {})[str(diameter)] = values

# A line for each number or list.
text = json.dumps(found, indent=1)
Path(__file__).with_name("certified.json").write_text(re.sub(r"\n\s+(?=[-\d\]])", " ", text) + "\n")
