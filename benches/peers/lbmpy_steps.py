"""Steps of lbmpy's D3Q15 with one relaxation time, 32 bits, vectorised, in place (aa) and with two copies (pull).

With neither walls nor inlet nor outlet: cells next to the faces find what they find. And in place with the faces of a wind (aa-faces):
inlet, outlet, ground, slip above and aside. Prints million cells a second. Usage: lbmpy_steps.py THREADS SIZES [ROUNDS]; AVX-512 unless LBMPY_TARGET names another target.
"""
import os
import sys
import time
import warnings

threads, sizes = int(sys.argv[1]), [int(n) for n in sys.argv[2].split(",")]
rounds = int(sys.argv[3]) if len(sys.argv) > 3 else 3
os.environ["OMP_NUM_THREADS"] = str(threads)

warnings.simplefilter("ignore")

import numpy as np
import pystencils as ps
from lbmpy import LBMConfig, LBMOptimisation, LBStencil, Method, Stencil, create_lb_update_rule
from lbmpy.advanced_streaming import Timestep
from lbmpy.boundaries import UBB, FixedDensity, FreeSlip, NoSlip
from lbmpy.boundaries.boundaryhandling import LatticeBoltzmannBoundaryHandling
from lbmpy.creationfunctions import create_lb_method
from pystencils.slicing import slice_from_direction

kernels = ps.CreateKernelConfig(target=getattr(ps.Target, os.environ.get("LBMPY_TARGET", "X86_AVX512")), default_dtype="float32")
kernels.cpu.vectorize.enable = True
kernels.cpu.vectorize.assume_inner_stride_one = True
kernels.cpu.openmp.enable = threads > 1
if threads > 1:
    kernels.cpu.openmp.num_threads = threads
method = dict(stencil=LBStencil(Stencil.D3Q15), method=Method.SRT, relaxation_rate=1 / 0.51, compressible=True, zero_centered=True)


def populations(n):
    """One array a direction, x fastest, a layer of ghosts around."""
    return np.zeros((15, n + 2, n + 2, n + 2), dtype=np.float32).transpose(3, 2, 1, 0)


def in_place(field):
    both = []
    for parity in (Timestep.EVEN, Timestep.ODD):
        config = LBMConfig(streaming_pattern="aa", timestep=parity, **method)
        rule = create_lb_update_rule(lbm_config=config, lbm_optimisation=LBMOptimisation(symbolic_field=field))
        both.append(ps.create_kernel(rule, kernels).compile())
    return both


def with_faces(n):
    """A slow wind along x over ground at y = 0."""
    data = ps.create_data_handling((n, n, n), default_target=ps.Target.CPU, default_layout="fzyx", default_ghost_layers=1)
    even, odd = in_place(data.add_array("a", values_per_cell=15, dtype=np.float32))
    data.fill("a", 0.0, ghost_layers=True)
    lattice, a = create_lb_method(LBMConfig(**method)), data.cpu_arrays["a"]
    faces = LatticeBoltzmannBoundaryHandling(
        lattice, data, "a", streaming_pattern="aa", target=ps.Target.CPU, openmp=threads > 1, default_dtype=np.float32
    )
    slip = {"T": (0, 0, -1), "B": (0, 0, 1), "N": (0, -1, 0)}
    for face, normal in slip.items():
        faces.set_boundary(FreeSlip(method["stencil"], normal_direction=normal), slice_from_direction(face, 3))
    faces.set_boundary(NoSlip(), slice_from_direction("S", 3))
    faces.set_boundary(UBB((0.02, 0, 0), data_type="float32"), slice_from_direction("W", 3))
    faces.set_boundary(FixedDensity(1.0), slice_from_direction("E", 3))
    faces.prepare()

    def both():
        faces(prev_timestep=Timestep.ODD)
        even(a=a)
        faces(prev_timestep=Timestep.EVEN)
        odd(a=a)

    return both, a


def two_steps(n, pattern):
    if pattern == "aa-faces":
        return with_faces(n)
    a, b = populations(n), populations(n)
    field = ps.Field.create_from_numpy_array("a", a, index_dimensions=1)
    if pattern == "aa":
        both = in_place(field)
        return lambda: [kernel(a=a) for kernel in both], a
    other = ps.Field.create_from_numpy_array("b", b, index_dimensions=1)
    copies = LBMOptimisation(symbolic_field=field, symbolic_temporary_field=other)
    rule = create_lb_update_rule(lbm_config=LBMConfig(streaming_pattern="pull", **method), lbm_optimisation=copies)
    kernel = ps.create_kernel(rule, kernels).compile()
    return lambda: (kernel(a=a, b=b), kernel(a=b, b=a)), a


for n in sizes:
    for pattern in ("aa", "aa-faces", "pull"):
        run, air = two_steps(n, pattern)
        run(), run()
        count, paces = max(2, int(2e7 / n**3)), []
        for _ in range(rounds):
            start = time.perf_counter()
            for _ in range(count):
                run()
            paces.append(2 * count * n**3 / (time.perf_counter() - start) / 1e6)
        print(f"lbmpy {pattern} n {n} threads {threads}: {sorted(paces)[len(paces) // 2]:.1f} million cells/s", flush=True)
        assert np.isfinite(air).all(), "the air blew up"
