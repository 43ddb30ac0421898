"""OpenCL: finding a device, compiling kernels, moving arrays. The only module that imports pyopencl."""

from __future__ import annotations

import tempfile
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyrt.errors import DeviceError
from pyrt.layout import is_aligned, kernel_dir
from pyrt.toolchain import ensure_cache, ensure_linker

LOCAL_SIZE = 64
# PoCL compiles a kernel anew for each local size, and for grids below 65,535 work-items, unless this process has
# launched it for larger ones. So its first grid is a large one.
_FIRST_GRID = 65_536


@dataclass(frozen=True)
class DeviceInfo:
    """One OpenCL device of this machine."""

    index: int
    name: str
    platform: str
    version: str  # of the platform; tells two PoCLs apart
    kind: str  # "cpu", "gpu" or "other"
    compute_units: int
    max_alloc: int  # bytes of the largest single buffer
    memory: int  # bytes
    raw: Any

    @property
    def is_pocl(self) -> bool:
        return "Portable Computing Language" in self.platform

    def __str__(self) -> str:
        return f"{self.name} ({self.version})"


def list_devices() -> list[DeviceInfo]:
    """All devices, in the driver's order.

    Raises:
        DeviceError: OpenCL itself cannot be loaded, or no platform is installed.
    """
    try:
        import pyopencl as cl
    except (ImportError, OSError) as error:
        raise DeviceError(f"OpenCL cannot be loaded ({error}); run: pip install 'pyopencl[pocl]'") from error
    devices: list[DeviceInfo] = []
    ensure_cache()
    try:
        platforms = cl.get_platforms()
    except cl.Error as error:
        raise DeviceError(f"no OpenCL platform found ({error}); run: pip install 'pyopencl[pocl]'") from error
    for platform in platforms:
        try:
            raw_devices = platform.get_devices()
        except cl.Error:
            continue  # a driver without a device
        for raw in raw_devices:
            devices.append(_describe(len(devices), platform, raw))
    return devices


def _describe(index: int, platform: Any, raw: Any) -> DeviceInfo:
    import pyopencl as cl

    kinds = {cl.device_type.CPU: "cpu", cl.device_type.GPU: "gpu"}
    return DeviceInfo(
        index=index,
        name=raw.name.strip(),
        platform=platform.name.strip(),
        version=platform.version.strip(),
        kind=kinds.get(raw.type & (cl.device_type.CPU | cl.device_type.GPU), "other"),
        compute_units=raw.max_compute_units,
        max_alloc=raw.max_mem_alloc_size,
        memory=raw.global_mem_size,
        raw=raw,
    )


def choose_device(wanted: str | int | None = None) -> DeviceInfo:
    """The device with the given index or whose name, platform or version contains the text; by default PoCL's CPU
    device, the newest if there are several, else the first device.

    Raises:
        DeviceError: there is no device, or none that fits.
    """
    devices = list_devices()
    if not devices:
        raise DeviceError("no OpenCL device found; run: pip install 'pyopencl[pocl]'")
    if wanted is None:
        pocl = [d for d in devices if d.is_pocl and d.kind == "cpu"]
        return max(pocl, key=lambda d: d.version) if pocl else devices[0]
    text = str(wanted)
    if text.isdigit():
        fits = [d for d in devices if str(d.index) == text]
    else:
        fits = [d for d in devices if text.lower() in f"{d.name} {d.platform} {d.version}".lower()]
    if not fits:
        names = "; ".join(f"{d.index}: {d}" for d in devices)
        raise DeviceError(f'no OpenCL device matches "{text}"; there are {names}')
    return fits[0]


@dataclass
class Kernel:
    """A compiled kernel, and whether it has run."""

    raw: Any
    launched: bool = False


class Device:
    """An opened device: a context, a queue, and the operations that rendering needs."""

    def __init__(self, wanted: str | int | None = None):
        import pyopencl as cl

        self.info = choose_device(wanted)
        if self.info.is_pocl:
            ensure_linker(self.info.version)
        self._cl = cl
        try:
            self._context = cl.Context([self.info.raw])
            self._queue = cl.CommandQueue(self._context)
        except cl.Error as error:
            raise DeviceError(f"{self.info}: cannot be opened ({error})") from error
        self.compile_seconds = 0.0

    @property
    def packet(self) -> int:
        """Samples that a work-item traces side by side, in the lanes of a processor's vector unit."""
        return 8 if self.info.kind == "cpu" else 1

    def check_threads(self, count: int) -> None:
        """Raises DeviceError unless the device has heard of `limit_threads`."""
        if not self.info.is_pocl or self.info.kind != "cpu" or self.info.compute_units > count:
            raise DeviceError(f"{self.info}: expected PoCL's CPU device, first used here, to limit its threads")

    @property
    def has_double(self) -> bool:
        """Whether kernels can compute in float64."""
        return "cl_khr_fp64" in self.info.raw.extensions.split()

    def build(self, source: str, options: Sequence[str]) -> dict[str, Kernel]:
        """Compiles a file of `kernels/`; returns its kernels by name."""
        cl, start = self._cl, perf_counter()
        folder = kernel_dir()
        flags = ["-cl-std=CL1.2", "-w", f"-DLOCAL_SIZE={LOCAL_SIZE}", *options]
        if self.info.raw.single_fp_config & cl.device_fp_config.CORRECTLY_ROUNDED_DIVIDE_SQRT:
            flags.append("-cl-fp32-correctly-rounded-divide-sqrt")
        with _include_option(folder) as include, warnings.catch_warnings():
            warnings.simplefilter("ignore", cl.CompilerWarning)
            try:
                program = cl.Program(self._context, (folder / source).read_text(encoding="utf-8"))
                # PoCL keeps compiled kernels itself, and its key covers the included headers.
                program.build([*flags, include], cache_dir=False)
            except cl.Error as error:
                first = next((line for line in str(error).splitlines() if "error:" in line), str(error).split("\n")[0])
                raise DeviceError(f"{self.info}: {source} does not compile: {first.strip()}") from error
        self.compile_seconds += perf_counter() - start
        # program.all_kernels() never lets go of them (pyopencl 2026.1), nor so of the program's 2 MB
        return {name: Kernel(cl.Kernel(program, name)) for name in program.kernel_names.split(";")}

    def check_buffer(self, name: str, nbytes: int) -> None:
        """Raises DeviceError if no buffer can be as large."""
        if nbytes > self.info.max_alloc:
            raise DeviceError(
                f"{self.info}: {name} needs {nbytes / 2**20:.0f} MiB, one buffer holds at most "
                f"{self.info.max_alloc / 2**20:.0f} MiB; expected a smaller scene or another --device"
            )

    def upload(self, name: str, array: NDArray[Any]) -> Any:
        """A read-only buffer with a copy of the array's bytes."""
        data = np.ascontiguousarray(array)
        self.check_buffer(name, data.nbytes)
        if not data.nbytes:
            data = np.zeros(16, np.uint8)  # OpenCL has no empty buffers
        flags = self._cl.mem_flags
        return self._cl.Buffer(self._context, flags.READ_ONLY | flags.COPY_HOST_PTR, hostbuf=data)

    def adopt(self, name: str, array: NDArray[Any]) -> Any:
        """As `upload`, of a contiguous array that nobody will write to any more: the buffer may be the array itself."""
        if self.info.kind != "cpu" or not array.nbytes or not is_aligned(array):
            return self.upload(name, array)
        self.check_buffer(name, array.nbytes)
        flags = self._cl.mem_flags
        return self._cl.Buffer(self._context, flags.READ_ONLY | flags.USE_HOST_PTR, hostbuf=array)

    def share(self, array: NDArray[Any]) -> Any:
        """A buffer that is the contiguous array itself where host and device share memory, and holds its content."""
        flags = self._cl.mem_flags
        access = flags.READ_WRITE if array.flags.writeable else flags.READ_ONLY
        return self._cl.Buffer(self._context, access | flags.USE_HOST_PTR, hostbuf=array)

    def receive(self, buffer: Any, array: NDArray[Any]) -> None:
        """Completes a shared array after kernels have written to its buffer."""
        with self.mapped(buffer, array.shape, array.dtype):
            pass

    def allocate(self, nbytes: int) -> Any:
        """A buffer for results, which `mapped` shows to the host."""
        flags = self._cl.mem_flags
        return self._cl.Buffer(self._context, flags.READ_WRITE | flags.ALLOC_HOST_PTR, max(nbytes, 16))

    def run(self, kernel: Kernel, items: int, *args: Any, fill: Sequence[NDArray[Any]] = ()) -> None:
        """Runs at least `items` work-items and waits. Its last arguments are contiguous arrays for results, `fill`."""
        size = -(-items // LOCAL_SIZE) * LOCAL_SIZE
        shared = [self.share(array) for array in fill]
        with self._waiting(kernel):
            grid = size if kernel.launched else max(size, _FIRST_GRID)
            kernel.raw(self._queue, (grid,), (LOCAL_SIZE,), *args, *shared)
            # to wait once for the kernel and all arrays takes half the time that waiting for each does
            for buffer, array in zip(shared, fill, strict=True):
                self._map(buffer, array.shape, array.dtype, False).base.release(self._queue)
        kernel.launched = True

    def run_each(self, kernel: Kernel, groups: int, *args: Any) -> None:
        """Runs `groups` work-groups of one work-item each, for few and long tasks, and waits."""
        with self._waiting(kernel):
            kernel.raw(self._queue, (groups,), (1,), *args)

    @contextmanager
    def _waiting(self, kernel: Kernel) -> Iterator[None]:
        """Waits for what the block enqueues, whatever ends it: the device may be at work on the caller's arrays."""
        try:
            try:
                yield
            finally:
                self._queue.finish()
        except self._cl.Error as error:
            raise DeviceError(f"{self.info}: {kernel.raw.function_name} failed: {error}") from error

    def _map(self, buffer: Any, shape: tuple[int, ...], dtype: Any, blocking: bool) -> Any:
        access = self._cl.map_flags.READ
        array, _ = self._cl.enqueue_map_buffer(self._queue, buffer, access, 0, shape, dtype, is_blocking=blocking)
        return array

    @contextmanager
    def mapped(self, buffer: Any, shape: tuple[int, ...], dtype: Any) -> Iterator[NDArray[Any]]:
        """The buffer's content as an array, valid inside the `with`; no copy where host and device share memory."""
        array = self._map(buffer, shape, np.dtype(dtype), True)
        try:
            yield array
        finally:
            array.base.release(self._queue)


@contextmanager
def _include_option(folder: Path) -> Iterator[str]:
    """The compiler's -I option for the folder. Not every compiler takes a path with spaces: then a link without."""
    if " " not in str(folder):
        yield f"-I{folder}"
        return
    with tempfile.TemporaryDirectory(prefix="pyrt-") as link:
        (Path(link) / "kernels").symlink_to(folder)
        yield f"-I{link}/kernels"
