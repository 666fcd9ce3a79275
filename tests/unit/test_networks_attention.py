"""Graph attention against torch_geometric's own layer, graphs, and the max-pool against brute force."""

import numpy as np
import pytest
import torch
from torch_geometric.nn import GATv2Conv

from pinnochio.networks import attention
from pinnochio.networks.attention import Attention
from pinnochio.networks.boundary import max_pool
from pinnochio.networks.graph import EDGE, Graph


def random_graph(n=40, seed=0):
    rng = np.random.default_rng(seed)
    cells = np.stack([rng.permutation(n)[:4] for _ in range(60)])
    return Graph.build(rng.normal(size=(n, 3)) * 10, cells)


@pytest.mark.skipif(attention.attention_cpu is None, reason="the fused loops need numba")
def test_fused_loop_equals_torch_geometric():
    torch.manual_seed(0)
    graph = random_graph()
    layer = Attention(32, 4)
    x = torch.randn(40, 32)
    weight = torch.randn(40, 32)

    def results(forward):
        start = x.clone().requires_grad_()
        out = forward(start, graph.edges, graph.attributes)
        gradients = torch.autograd.grad((out * weight).sum(), [start, *layer.parameters()])
        return [out.detach(), *gradients]

    fused = results(layer)
    general = results(lambda *inputs: GATv2Conv.forward(layer, *inputs))
    for mine, theirs in zip(fused, general, strict=True):
        assert torch.allclose(mine, theirs, rtol=1e-4, atol=1e-5 * float(theirs.abs().max()))


def test_attention_weights_survive_large_scores():
    torch.manual_seed(0)
    graph = random_graph()
    out = Attention(32, 4)(1e4 * torch.randn(40, 32), graph.edges, graph.attributes)
    assert torch.isfinite(out).all()


def test_graph_has_each_mesh_edge_both_ways_and_every_loop_sorted_by_target():
    points = np.array([[0.0, 0, 0], [5, 0, 0], [0, 5, 0], [0, 0, 5], [9, 9, 9]])
    graph = Graph.build(points, np.array([[0, 1, 2, 3], [3, 2, 1, 0]]))
    pairs = {tuple(pair) for pair in graph.edges.T.tolist()}
    assert pairs == {(a, b) for a in range(4) for b in range(4)} | {(4, 4)}
    assert len(pairs) == graph.edges.shape[1]
    assert (graph.edges[1].diff() >= 0).all()
    at = graph.edges.T.tolist().index([1, 0])
    assert graph.attributes[at].tolist() == pytest.approx([5 / EDGE, 0, 0, 5 / EDGE])


def test_mirrored_graph_is_the_graph_of_mirrored_points():
    rng = np.random.default_rng(1)
    points, cells = rng.normal(size=(9, 3)), np.array([[0, 1, 2, 3], [4, 5, 6, 7], [5, 6, 7, 8]])
    flip = np.array([-1.0, 1, 1])
    mine = Graph.build(points, cells).mirrored(torch.tensor(flip, dtype=torch.float32))
    direct = Graph.build(points * flip, cells)
    assert torch.equal(mine.edges, direct.edges)
    assert torch.allclose(mine.attributes, direct.attributes, atol=1e-6)
    assert torch.allclose(mine.points, direct.points)


def test_max_pool_takes_each_channel_from_the_listed_neighbours_alone():
    features = torch.randn(20, 6, generator=torch.Generator().manual_seed(0))
    neighbours = torch.tensor([[0, 3, 5], [19, 19, 2]])
    expected = torch.stack([torch.stack([features[j] for j in row]).max(0).values for row in neighbours])
    assert torch.equal(max_pool(features, neighbours), expected)
