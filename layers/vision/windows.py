"""Geometry of sliding windows over spatial axes: kernel, stride, pad, dilation, number of windows,
and their errors.

Base class of Convolution, Deconvolution, Im2col, Pooling and SPP. Along an axis of n values with
padding p on both sides, a window of k elements with dilation d has extent d (k - 1) + 1, and
floor((n + 2 p - extent) / stride) + 1 windows fit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from netlib.blob import Array, Blob
from netlib.fillers import Filler
from netlib.layer import Layer, warn_of_ignored
from netlib.proto import schema
from netlib.proto.schema import Engine, UInt, numbered


@dataclass(frozen=True)
class ConvolutionParameter:
    """The ``convolution_param { ... }`` block of Convolution, Deconvolution and Im2col."""

    num_output: UInt = numbered(1, 0)
    bias_term: bool = numbered(2, True)
    pad: tuple[UInt, ...] = numbered(3, ())  # one number for all spatial axes, or one each
    kernel_size: tuple[UInt, ...] = numbered(4, ())
    stride: tuple[UInt, ...] = numbered(6, ())
    dilation: tuple[UInt, ...] = numbered(18, ())
    pad_h: UInt | None = numbered(9, None)  # options with _h and _w are for two spatial axes
    pad_w: UInt | None = numbered(10, None)
    kernel_h: UInt | None = numbered(11, None)
    kernel_w: UInt | None = numbered(12, None)
    stride_h: UInt | None = numbered(13, None)
    stride_w: UInt | None = numbered(14, None)
    group: UInt = numbered(5, 1)
    weight_filler: Filler = numbered(7, Filler())
    bias_filler: Filler = numbered(8, Filler())
    engine: Engine = numbered(15, "DEFAULT")  # accepted, ignored
    axis: int = numbered(16, 1)  # axis of the channels
    force_nd_im2col: bool = numbered(17, False)  # accepted, ignored


@dataclass(frozen=True)
class PoolingParameter:
    """The ``pooling_param { ... }`` block."""

    pool: Literal["MAX", "AVE", "STOCHASTIC"] = numbered(1, "MAX")
    kernel_size: UInt | None = numbered(2, None)
    kernel_h: UInt | None = numbered(5, None)
    kernel_w: UInt | None = numbered(6, None)
    pad: UInt = numbered(4, 0)
    pad_h: UInt | None = numbered(9, None)
    pad_w: UInt | None = numbered(10, None)
    stride: UInt = numbered(3, 1)
    stride_h: UInt | None = numbered(7, None)
    stride_w: UInt | None = numbered(8, None)
    global_pooling: bool = numbered(12, False)  # one window that covers the map
    round_mode: Literal["CEIL", "FLOOR"] = numbered(13, "CEIL")
    # of PyTorch's converters and some forks: true is CEIL, false is FLOOR
    ceil_mode: bool | None = numbered(14, None)
    engine: Engine = numbered(11, "DEFAULT")  # accepted, ignored


class SlidingWindow(Layer):
    """Base class of layers with sliding windows.

    kernel, stride, pad, dilation  one number per spatial axis
    axis                           axis of the channels; the spatial axes follow it
    """

    kernel: tuple[int, ...]
    stride: tuple[int, ...]
    pad: tuple[int, ...]
    dilation: tuple[int, ...]
    axis = 1

    # ---------------------------------------------------------------------------- convolution_param

    def _read_windows(self, bottom: Blob) -> None:
        """Read axis, number of channels and geometry from a ``convolution_param``.

        Raises LayerError.
        """
        p = self.param
        self.axis = self.canonical_axis(p.axis, bottom)
        self.batchwise = self.axis > 0
        self.channels, *sizes = bottom.shape[self.axis :]
        self.kernel = self._each("kernel", p.kernel_size, (p.kernel_h, p.kernel_w), 0, len(sizes))
        self.stride = self._each("stride", p.stride, (p.stride_h, p.stride_w), 1, len(sizes))
        self.pad = self._each("pad", p.pad, (p.pad_h, p.pad_w), 0, len(sizes))
        self.dilation = self._each("dilation", p.dilation, (None, None), 1, len(sizes))
        self._check_sizes()
        if 0 in self.dilation:
            raise self.fail(f"dilation is {self.dilation}, expected at least 1", "dilation")

    def _each(
        self,
        name: str,
        given: tuple[int, ...],
        h_w: tuple[int | None, int | None],
        default: int,
        axes: int,
    ) -> tuple[int, ...]:
        """Expand an option to one number per spatial axis.

        It can be given once, per axis, or not at all.
        """
        option = "kernel_size" if name == "kernel" else name
        if h_w != (None, None):
            if given:
                raise self.fail(f"give either {option}, or {name}_h and {name}_w", option)
            if axes != 2:
                raise self.fail(
                    f"{name}_h and {name}_w are for 2 spatial axes, found {axes}; expected {option}"
                )
            given = tuple(value or 0 for value in h_w)
        if len(given) > 1 and len(given) != axes:
            raise self.fail(f"{len(given)} values of {option} for {axes} spatial axes", option)
        return given if len(given) > 1 else (given or (default,)) * axes

    def _read_convolution(self, bottom: Blob) -> None:
        """Read the geometry, and check the numbers of channels, outputs and groups.

        Raises LayerError.
        """
        self._read_windows(bottom)
        p, channels = self.param, self.channels
        if min(p.num_output, p.group) < 1:
            raise self.fail(
                "num_output and group must be at least 1", "num_output" if p.group else "group"
            )
        if channels == 0:
            raise self.fail(f"bottom {self.spec.bottom[0]!r} {bottom.shape} has no channels")
        if channels % p.group or p.num_output % p.group:
            raise self.fail(
                f"group {p.group} must divide {channels} channels and num_output {p.num_output}",
                "group",
            )

    def _check_axes(self, i: int, x: Blob, weight: Sequence[int] | None = None) -> None:
        """Check the number of spatial axes and of channels against those at setup.

        Raises LayerError.
        """
        name = self.spec.bottom[i]
        if len(x.shape) != self.axis + 1 + len(self.kernel):
            raise self.fail(
                f"bottom {name!r} has shape {x.shape}, "
                f"expected {len(self.kernel)} spatial axes after axis {self.axis}"
            )
        channels = x.shape[self.axis]
        if weight is not None and channels != self.channels:
            raise self.fail(
                f"bottom {name!r} has {channels} channels {x.shape}, "
                f"its weights {weight} expect {self.channels}"
            )

    def _check_sizes(self) -> None:
        """Raise LayerError if a number of the kernel or the stride is 0 or missing."""
        if 0 in self.kernel:
            raise self.fail(
                "needs kernel_size, or kernel_h and kernel_w, of at least 1", "kernel_size"
            )
        if 0 in self.stride:
            raise self.fail(
                f"stride is {self.stride}; expected stride, or stride_h and stride_w, of at least 1",
                "stride",
            )

    def _extent(self) -> tuple[int, ...]:
        """Size of the dilated kernel."""
        return tuple(d * (k - 1) + 1 for d, k in zip(self.dilation, self.kernel))

    # -------------------------------------------------------------------------------- pooling_param

    def _read_pooling(self) -> None:
        """Read the geometry from a ``pooling_param``; the kernel is (0, 0) for global pooling.

        Raises LayerError.
        """
        for option, name in (("kernel_size", "kernel"), ("pad", "pad"), ("stride", "stride")):
            self._check_alternatives(option, name)
        p = self.param = self._rounded(self.param)
        self.pad = (_or(p.pad_h, p.pad), _or(p.pad_w, p.pad))
        self.stride = (_or(p.stride_h, p.stride), _or(p.stride_w, p.stride))
        self.kernel = (p.kernel_h or 0, p.kernel_w or 0)
        if p.kernel_size is not None:
            self.kernel = (p.kernel_size, p.kernel_size)
        if p.global_pooling:
            if self.kernel != (0, 0):
                raise self.fail("global_pooling does not allow a kernel size", "global_pooling")
            if (self.pad, self.stride) != ((0, 0), (1, 1)):
                raise self.fail("global_pooling needs pad 0 and stride 1", "global_pooling")
            return
        self._check_sizes()
        if any(pad >= k for pad, k in zip(self.pad, self.kernel)):
            raise self.fail(f"pad {self.pad} must be smaller than the kernel {self.kernel}", "pad")

    def _check_alternatives(self, option: str, name: str) -> None:
        """Raise LayerError unless an option is given once for both axes, or for each, or not."""
        block = self.spec.blocks.get("pooling_param")
        names = (option, f"{name}_h", f"{name}_w")
        is_given, has_h, has_w = (block is not None and bool(block.values(n)) for n in names)
        if is_given and option == "kernel_size" and has_h != has_w:  # Caffe accepts only this pair
            warn_of_ignored(self, "kernel_h", "kernel_w", advice="; kernel_size takes precedence")
        elif is_given and (has_h or has_w):
            raise self.fail(f"give either {option}, or {name}_h and {name}_w", option)
        elif has_h != has_w:
            raise self.fail(f"needs {option}, or {name}_h and {name}_w", option)

    def _rounded(self, p: PoolingParameter) -> PoolingParameter:
        """The options with ``ceil_mode`` as ``round_mode``.

        Raises LayerError if they contradict each other.
        """
        if p.ceil_mode is None:
            return p
        rounded = "CEIL" if p.ceil_mode else "FLOOR"
        if schema.is_given(p, "round_mode") and p.round_mode != rounded:
            raise self.fail(
                f"ceil_mode: {str(p.ceil_mode).lower()} is round_mode: {rounded}, but "
                f"round_mode: {p.round_mode} is given; expected one of them",
                "ceil_mode",
            )
        return schema.changed(p, round_mode=rounded)

    def _check_map(self, x: Blob) -> None:
        """Raise LayerError unless the bottom is a non-empty map with four axes."""
        if len(x.shape) != 4 or 0 in x.shape[2:]:
            raise self.fail(
                f"bottom {self.spec.bottom[0]!r} has shape {x.shape}, expected (N, C, H, W)"
            )

    def padded(self, x: Array, y_shape: tuple[int, ...], value: float) -> Array:
        """Pad x (C, H, W), including the parts of windows that extend beyond the padding."""
        after = []
        sizes = zip(y_shape[2:], self.stride, self.kernel, x.shape[1:], self.pad)
        for outputs, stride, kernel, n, pad in sizes:
            extent = (outputs - 1) * stride + kernel  # of all windows
            after.append(max(extent - n - pad, pad))
        return np.pad(x, [(0, 0), *zip(self.pad, after)], constant_values=value)


def _or(value: int | None, default: int) -> int:
    return default if value is None else value
