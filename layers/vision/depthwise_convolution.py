"""DepthwiseConvolution and ConvolutionDepthwise: convolution of each channel with separate
kernels (MobileNet).

bottom[i]  x  (N, C, H, W)
params[0]  w  (O, 1, kh, kw)   O is a multiple of C, mostly C
params[1]  b  (O,)             unless ``bias_term: false``
top[i]     y  (N, O, Ho, Wo)

This is a Convolution with ``group: C`` (convolution.py has the formulas), with weights of the same
shapes. In forks of Caffe the layer has two names, which differ in two options:

    DepthwiseConvolution    reads num_output and group; with another group than C its results differ
                            between CPU and GPU
    ConvolutionDepthwise    ignores num_output and group and has C outputs; it has one bottom and
                            two spatial axes
"""

from __future__ import annotations

from layers.common.images import check_images
from layers.vision.convolution import Convolution
from netlib.blob import Blobs
from netlib.layer import warn
from netlib.proto import schema


class DepthwiseConvolution(Convolution):
    """Convolution of each channel on its own, with the options of Convolution."""

    param_name = "convolution_param"

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        p, axis = self.param, self.canonical_axis(self.param.axis, bottom[0])
        channels = bottom[0].shape[axis]
        if p.group != channels:
            raise self.fail(
                f"group is {p.group}, but bottom {self.spec.bottom[0]!r} has {channels} channels; expected "
                f"group: {channels}, or the type Convolution",
                "group",
            )
        super().setup(bottom, top)


class ConvolutionDepthwise(Convolution):
    """Convolution of each channel on its own, with as many outputs as channels."""

    param_name = "convolution_param"
    bottoms = tops = (1, 1)

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        check_images(self, bottom)
        channels = bottom[0].shape[1]
        for name in ("num_output", "group"):
            given = getattr(self.param, name)
            if schema.is_given(self.param, name) and given != channels:
                warn(
                    self,
                    f"{self.type} ignores {name} {given}, as in Caffe's forks: it has a group and an output for "
                    f"each of the {channels} channels",
                    schema.position_of(self.param, name),
                )
        self.param = schema.changed(self.param, num_output=channels, group=channels, axis=1)
        super().setup(bottom, top)
