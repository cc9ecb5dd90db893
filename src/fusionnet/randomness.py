"""Named random generators, all derived from one seed.

There is no global randomness in FusionNet. Everything random takes a generator,
and generators come from here: `generator(seed, "train", 731, "camera")` is the
same stream on every machine and in every process, so sample 731 can be rebuilt
alone and the number of workers changes nothing.
"""

import hashlib

import numpy as np

Purpose = str | int


def derived_seed(seed: int, *purpose: Purpose) -> int:
    """A 63-bit seed that depends on `seed` and on every part of `purpose`."""
    text = repr((int(seed), *purpose)).encode()
    return int.from_bytes(hashlib.blake2b(text, digest_size=8).digest(), "big") >> 1


def generator(seed: int, *purpose: Purpose) -> np.random.Generator:
    """A NumPy generator for one purpose, derived from one seed."""
    return np.random.default_rng(derived_seed(seed, *purpose))
