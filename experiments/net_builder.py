"""Nets as text, built layer by layer."""

from __future__ import annotations

from collections.abc import Sequence

FILLER = 'weight_filler { type: "msra" }'


class NetBuilder:
    """The layers of a net.

    Every method adds layers behind the blob ``bottom`` and returns the name of the top.

    batch_norm_in_place  whether BatchNorm behind a convolution is in place
    """

    def __init__(self, *shape: int) -> None:
        self.batch_norm_in_place = True
        self.lines: list[str] = []
        self.input("data", *shape)

    def input(self, top: str, *shape: int) -> None:
        """Add an Input layer."""
        sizes = " ".join(f"dim: {n}" for n in shape)
        self.lines.append(
            f'layer {{ name: "{top}" type: "Input" top: "{top}" input_param {{ shape {{ {sizes} }} }} }}'
        )

    def add(self, type_: str, bottoms: Sequence[str], options: str = "", top: str = "") -> str:
        """Add a layer; by default with a new top that has its name."""
        name = f"n{len(self.lines)}"
        top = top or name
        reads = " ".join(f'bottom: "{bottom}"' for bottom in bottoms)
        blobs = f'{reads} top: "{top}"'
        self.lines.append(f'layer {{ name: "{name}" type: "{type_}" {blobs} {options} }}')
        return top

    def relu(self, bottom: str) -> str:
        """ReLU in place."""
        return self.add("ReLU", [bottom], top=bottom)

    def conv(
        self,
        bottom: str,
        count: int,
        kernel: int,
        stride: int = 1,
        pad: int = 0,
        group: int = 1,
        relu: bool = True,
        batch_norm: bool = False,
    ) -> str:
        """Convolution, with BatchNorm and Scale in place of a bias, and a ReLU."""
        window = f"kernel_size: {kernel} stride: {stride} pad: {pad} group: {group}"
        bias = "bias_term: false" if batch_norm else ""
        options = f"convolution_param {{ num_output: {count} {window} {bias} {FILLER} }}"
        top = self.add("Convolution", [bottom], options)
        if batch_norm:
            top = self.batch_norm(top, top if self.batch_norm_in_place else "")
        return self.relu(top) if relu else top

    def batch_norm_relu(self, bottom: str) -> str:
        """BatchNorm, and behind it in place Scale and ReLU."""
        return self.relu(self.batch_norm(bottom))

    def batch_norm(self, bottom: str, top: str = "") -> str:
        """BatchNorm, and behind it in place Scale."""
        top = self.add("BatchNorm", [bottom], top=top)
        return self.add("Scale", [top], "scale_param { bias_term: true }", top=top)

    def pool(self, bottom: str, kernel: int, stride: int, pad: int = 0, kind: str = "MAX") -> str:
        """Pooling; over the whole map if ``kernel`` is 0."""
        options = f"kernel_size: {kernel} stride: {stride} pad: {pad}"
        if not kernel:
            options = "global_pooling: true"
        return self.add("Pooling", [bottom], f"pooling_param {{ pool: {kind} {options} }}")

    def product(self, bottom: str, count: int) -> str:
        """InnerProduct."""
        options = f"inner_product_param {{ num_output: {count} {FILLER} }}"
        return self.add("InnerProduct", [bottom], options)

    def hidden(self, bottom: str, count: int) -> str:
        """InnerProduct and a ReLU."""
        return self.relu(self.product(bottom, count))

    def average(self, bottom: str) -> str:
        """The mean of each channel."""
        return self.pool(bottom, 0, 1, kind="AVE")

    def lrn(self, bottom: str) -> str:
        """Local response normalization with AlexNet's options."""
        return self.add("LRN", [bottom], "lrn_param { local_size: 5 alpha: 0.0001 beta: 0.75 }")
