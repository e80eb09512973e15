"""A triplet loss as a layer of type Python, with the habits of published ones, and its training."""

import caffe
import numpy as np
from caffe._caffe import RawBlobVec


class TripletLayer(caffe.Layer):
    def setup(self, bottom, top):
        """Setup the TripletLayer."""
        assert isinstance(bottom, RawBlobVec)
        assert np.shape(bottom[0].data) == np.shape(bottom[1].data) == np.shape(bottom[2].data)
        self.margin = eval(self.param_str)["margin"]
        self.a = 1
        top[0].reshape(1)

    def reshape(self, bottom, top):
        pass

    def forward(self, bottom, top):
        """Get blobs and copy them into this layer's top blob vector."""
        loss = float(0)
        self.no_residual_list = []
        for i in range(bottom[0].num):
            a, p, n = (np.array(b.data[i]) for b in bottom)
            dist = self.margin + np.dot(a - p, a - p) - np.dot(a - n, a - n)
            _loss = max(dist, 0.0)
            if i == 0 and dist <= 0:
                print("loss: %f" % _loss)
            if _loss == 0:
                self.no_residual_list.append(i)
            loss += _loss
        top[0].data[...] = loss / (2.0 * bottom[0].num)

    def backward(self, top, propagate_down, bottom):
        for i in range(len(bottom)):
            if not propagate_down[i]:
                continue
            for j in range(bottom[0].num):
                if j not in self.no_residual_list:
                    a, p, n = (b.data[j] for b in bottom)
                    gradient = [n - p, p - a, a - n][i]
                    bottom[i].diff[j] = self.a * gradient * top[0].diff / bottom[0].num
                else:
                    bottom[i].diff[j] = np.zeros_like(bottom[i].data[j])


NET = """
force_backward: true
layer { name: "data" type: "DummyData" top: "a" top: "p" top: "n"
        dummy_data_param { shape { dim: 6 dim: 4 } data_filler { type: "gaussian" std: 1 } } }
%s
layer { name: "loss" type: "Python" bottom: "fa" bottom: "fp" bottom: "fn" top: "loss" loss_weight: 1
        python_param { module: "triplet" layer: "TripletLayer" param_str: "{'margin': 0.5}" } }
""" % "\n".join(
    'layer { name: "f%s" type: "InnerProduct" bottom: "%s" top: "f%s" param { name: "w" } '
    'inner_product_param { num_output: 3 bias_term: false weight_filler { type: "xavier" } } }' % (x, x, x)
    for x in "apn"
)

if __name__ == "__main__":
    open("triplet.prototxt", "w").write(NET)
    open("triplet_solver.prototxt", "w").write(
        'net: "triplet.prototxt" base_lr: 0.02 momentum: 0.9 lr_policy: "fixed" random_seed: 1 display: 0'
    )
    caffe.set_mode_cpu()
    solver = caffe.SGDSolver("triplet_solver.prototxt")
    losses = []
    for it in range(20):
        solver.step(1)
        losses.append(float(solver.net.blobs["loss"].data[0]))
    a, p, n = (solver.net.blobs[name].data for name in ("fa", "fp", "fn"))
    expected = np.maximum(0.5 + ((a - p) ** 2).sum(1) - ((a - n) ** 2).sum(1), 0).mean() / 2
    assert abs(losses[-1] - expected) < 1e-5, (losses[-1], expected)
    assert len(set(losses)) == 20
    print("loss %.3f" % losses[-1])
