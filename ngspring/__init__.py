"""Inverse design of springs with a prescribed nonlinear load-displacement curve.

After Bluhm, Sigmund and Poulios (2023), Int. J. Non-Linear Mech. 157, 104552,
https://doi.org/10.1016/j.ijnonlinmec.2023.104552. Lengths are in mm, forces in N, stress in MPa.
"""

import lazy_loader

from ngspring.basics.version import __version__ as __version__

# The public names stand in `__init__.pyi`; each is imported at its first use, so that
# `import ngspring` is quick.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
