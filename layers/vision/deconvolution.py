r"""Deconvolution: a transposed convolution, which upsamples an image.

bottom[i]  x  (N, C, H, W)
params[0]  w  (C, O / group, kh, kw)
params[1]  b  (O,)            unless ``bias_term: false``
top[i]     y  (N, O, Ho, Wo)  Ho = stride (H - 1) + dilation (kh - 1) + 1 - 2 pad, same for Wo

Every value of x adds a kernel, scaled by this value, to y:

y              = b[o] + every x[n, c, h, w] w[c, o, i, j], added at
                 n, o, h stride + i dilation - pad, w stride + ...
dx[n, c, h, w] = sum over o, i, j of
                 w[c, o, i, j] dy[n, o, h stride + i dilation - pad, w stride + ...]
dw[c, o, i, j] = sum over n, h, w of
                 x[n, c, h, w] dy[n, o, h stride + i dilation - pad, w stride + ...]
db[o]          = sum over n, h, w of dy

Compared with a Convolution from y to x with the same w, forward and backward are exchanged.
Options, spatial axes, im2col and col2im are those of Convolution (convolution.py).
"""

from __future__ import annotations

from layers.vision.convolution import Convolution
from netlib.blob import Blob, Blobs


class Deconvolution(Convolution):
    """Transposed convolution."""

    param_name = "convolution_param"

    def _weight_shape(self) -> tuple[int, ...]:
        """Shape of w, inputs first."""
        return (self.channels, self.param.num_output // self.param.group, *self.kernel)

    def _outputs(self, i: int, x: Blob) -> list[int]:
        """Ho and Wo. Raises LayerError if the padding leaves no output."""
        sizes = zip(x.shape[self.axis + 1 :], self.stride, self._extent(), self.pad)
        out = [stride * (n - 1) + extent - 2 * pad for n, stride, extent, pad in sizes]
        if min(out, default=1) < 1:
            raise self.fail(
                f"pad {self.pad} leaves no output of bottom {self.spec.bottom[i]!r} {x.shape}",
                "pad",
            )
        return out

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        w = self.by_group(self.weight.data)
        for x, y in zip(bottom, top):
            for image, out in zip(self.images(x.data), self.images(y.data)):
                out[...] = self.col2im(
                    w.swapaxes(1, 2) @ self.by_group(image), out.shape, image.shape
                )
                if self.param.bias_term:
                    out += self.bias.data.reshape(-1, *(1,) * len(self.kernel))

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        w, dw = self.by_group(self.weight.data), self.by_group(self.weight.diff)
        for x, y, down in zip(bottom, top, propagate_down):
            for n, (image, gradient) in enumerate(zip(self.images(x.data), self.images(y.diff))):
                columns = self.by_group(self.im2col(gradient, image.shape))
                dw += self.by_group(image) @ columns.swapaxes(1, 2)
                if self.param.bias_term:
                    self.bias.diff[...] += gradient.reshape(len(gradient), -1).sum(axis=1)
                if down:
                    self.images(x.diff)[n] = (w @ columns).reshape(image.shape)
