"""Steps of lbmpy's D3Q15 with one relaxation time, 32 bits, vectorised, in place (aa) and with two copies (pull).

Prints million cells a second. Usage: lbmpy_steps.py THREADS SIZES [ROUNDS]; AVX-512 unless LBMPY_TARGET names another target.
"""
import os
import sys
import time

threads, sizes = int(sys.argv[1]), [int(n) for n in sys.argv[2].split(",")]
rounds = int(sys.argv[3]) if len(sys.argv) > 3 else 3
os.environ["OMP_NUM_THREADS"] = str(threads)

import numpy as np
import pystencils as ps
from lbmpy import LBMConfig, LBMOptimisation, LBStencil, Method, Stencil, create_lb_update_rule
from lbmpy.advanced_streaming import Timestep

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


def two_steps(n, pattern):
    a, b = populations(n), populations(n)
    field = ps.Field.create_from_numpy_array("a", a, index_dimensions=1)
    if pattern == "aa":
        both = []
        for parity in (Timestep.EVEN, Timestep.ODD):
            config = LBMConfig(streaming_pattern="aa", timestep=parity, **method)
            rule = create_lb_update_rule(lbm_config=config, lbm_optimisation=LBMOptimisation(symbolic_field=field))
            both.append(ps.create_kernel(rule, kernels).compile())
        return lambda: [kernel(a=a) for kernel in both]
    other = ps.Field.create_from_numpy_array("b", b, index_dimensions=1)
    copies = LBMOptimisation(symbolic_field=field, symbolic_temporary_field=other)
    kernel = ps.create_kernel(create_lb_update_rule(lbm_config=LBMConfig(streaming_pattern="pull", **method), lbm_optimisation=copies), kernels).compile()
    return lambda: (kernel(a=a, b=b), kernel(a=b, b=a))


for n in sizes:
    for pattern in ("aa", "pull"):
        run = two_steps(n, pattern)
        run(), run()
        count, paces = max(2, int(2e7 / n**3)), []
        for _ in range(rounds):
            start = time.perf_counter()
            for _ in range(count):
                run()
            paces.append(2 * count * n**3 / (time.perf_counter() - start) / 1e6)
        print(f"lbmpy {pattern} n {n} threads {threads}: {sorted(paces)[len(paces) // 2]:.1f} million cells/s", flush=True)
