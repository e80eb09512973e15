"""The inputs of a deploy net, in the place of the layers that read its data in training.

Each input has the shape that its reader gives to one item, and comments on how the training
transformed its images.
"""

from __future__ import annotations

import shlex
from pathlib import Path

from netlib.errors import DataError, LayerError, NetlibError, PrototxtError
from netlib.files.paths import find
from netlib.net import Net
from netlib.proto import prototxt, schema
from netlib.proto.binaryproto import read_blob
from netlib.proto.messages import LayerParameter, NetParameter
from netlib.proto.options import layer_types
from netlib.proto.prototxt import Message, Scalar
from tools.common.commands import command

Shape = tuple[int, ...]

COLORS = 3
# Options of readers for the height and the width of their images, in the order of precedence
SIZE_OPTIONS = (
    ("crop_size", "crop_size"), ("crop_height", "crop_width"), ("crop_h", "crop_w"), ("new_height", "new_width"),
    ("height", "width"),
)  # fmt: skip


class DeployInput:
    """An input in the place of a top of a reader, a layer that reads data.

    name  name of the blob
    """

    def __init__(self, reader: LayerParameter, index: int) -> None:
        self._reader = reader
        self._index = index
        self.name = reader.top[index]
        self._transform = reader.blocks.get("transform_param", prototxt.parse(""))
        # in older nets the reader's own block has the options of the transformation
        self._blocks = [self._transform, *reader.blocks.values()]

    def layer(self, shape: Shape | None) -> LayerParameter:
        """The Input layer, with this shape or that of one item.

        Raises NetlibError if that of an item is unknown.
        """
        dims = "".join(f" dim: {n}" for n in shape or self._shape())
        block = prototxt.parse(f"shape {{{dims} }}")
        return LayerParameter(
            name=self.name, type="Input", top=(self.name,), blocks={"input_param": block}
        )

    def comments(self, out: Path) -> list[str]:
        """What the training did to images before the net read them, and the options of the command
        that repeats it.
        """
        reader = self._reader
        transform = self._transform.fields
        lines = [
            f"Input {self.name!r} is in the place of layer {reader.name!r} of type {reader.type}."
        ]
        if transform:
            fields = [" ".join(str(Message([item], item.position)).split()) for item in transform]
            lines.append(f"Its images were transformed by: {'; '.join(fields)}")
        options = self._command_options()
        if self._index == 0 and reader.type != "HDF5Data" and (options or transform):
            run = f"{command('run_net')} {shlex.quote(str(out))} WEIGHTS IMAGE"
            lines.append(" ".join([f"Run it: {run}", *options]))
        return lines

    def _command_options(self) -> list[str]:
        """The options of tools/run_net.py that transform an image as the training did."""
        options = []
        if means := self._numbers("mean_value"):
            options.append(f"--mean {','.join(f'{mean:.9g}' for mean in means)}")
        if file := self._word("mean_file"):
            options.append(f"--mean-file {shlex.quote(file)}")
        if scale := self._numbers("scale"):
            options.append(f"--scale {scale[0]:.9g}")
        return options

    # ---------------------------------------------------------------------------------------- shape

    def _shape(self) -> Shape:
        """The shape of one item, from the data themselves, or else from the options.

        Raises NetlibError.
        """
        if shape := self._shape_of_data():
            return shape
        size = self._size()
        mean = self._mean_shape()
        if self._index > 0 or not (size or mean):
            raise NetlibError(
                f"{schema.position_of(self._reader)}: the shape of {self.name!r} is not in the prototxt, and its data "
                f"are not here; give it by --shape, for example --shape {self.name}=1,{self._channels(())},224,224"
            )
        return (1, self._channels(mean), *(size or mean[1:]))

    def _shape_of_data(self) -> Shape:
        """The shape of one item that the reader makes; of an Input layer, of its whole batch.

        Empty if the data are not here, or in a format that only Caffe reads.
        """
        if self._reader.type not in layer_types():
            return ()
        reader = schema.changed(self._reader, include=(), exclude=())  # in every phase
        try:
            shape = Net(NetParameter(layer=(reader,))).blobs[self.name].shape
        except (DataError, LayerError, PrototxtError):
            return ()
        return shape if reader.type == "Input" else (1, *shape[1:])

    def _size(self) -> Shape:
        """Height and width from the options; empty if unknown."""
        for names in SIZE_OPTIONS:
            sides = [self._numbers(name) for name in names]
            if all(side and side[0] > 0 for side in sides):
                return tuple(int(side[0]) for side in sides)
        return ()

    def _mean_shape(self) -> Shape:
        """Channels, height and width of the mean image; empty if it is not here."""
        name = self._word("mean_file")
        if not name:
            return ()
        try:
            mean = read_blob(find(name, schema.position_of(self._reader).source))
        except NetlibError:
            return ()
        return mean.shape[-3:]

    def _channels(self, mean: Shape) -> int:
        """Channels of an image, from the options or the shape of the mean image."""
        if channels := self._numbers("channels"):
            return int(channels[0])
        if self._truth("is_color") is False or self._truth("force_gray"):
            return 1
        return mean[0] if mean else max(COLORS, len(self._numbers("mean_value")))

    # -------------------------------------------------------------------------------------- options

    def _numbers(self, name: str) -> list[float]:
        """The numbers of the first block or message in a block with this option."""
        for block in self._blocks:
            messages = [item.value for item in block.fields if isinstance(item.value, Message)]
            for message in (block, *messages):
                texts = [value.text for value in message.values(name) if isinstance(value, Scalar)]
                if texts:
                    return [float(text.removesuffix("f")) for text in texts]
        return []

    def _truth(self, name: str) -> bool | None:
        """The first block's value of an option that is true or false; None if there is none."""
        for block in self._blocks:
            value = block.truth(name)
            if value is not None:
                return value
        return None

    def _word(self, name: str) -> str:
        """The text of the first block with this option; empty if there is none."""
        return next(filter(None, (block.text(name) for block in self._blocks)), "")
