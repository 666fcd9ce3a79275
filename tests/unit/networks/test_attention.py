"""Graph attention against torch_geometric's own layer, graphs, and the max-pool against brute force."""

import numpy as np
import pytest
import torch
from torch_geometric.nn import GATv2Conv

from pinnochio.networks import gatv2
from pinnochio.networks.boundary import BoundaryNetwork, max_pool
from pinnochio.networks.gatv2 import Attention, Encoder
from pinnochio.networks.graph import EDGE, Graph
from pinnochio.networks.layout import Layout
from tests.helpers.settings import network_settings

DEVICES = [
    "cpu",
    pytest.param(
        "cuda",
        marks=pytest.mark.skipif(
            gatv2.gatv2_gpu is None or not torch.cuda.is_available(), reason="the kernels need a GPU and Triton"
        ),
    ),
]


def random_graph(n=40, seed=0, device="cpu"):
    """A graph whose first node is joined to all others, so that the numbers of edges per node differ widely."""
    rng = np.random.default_rng(seed)
    cells = np.stack([rng.permutation(n)[:4] for _ in range(60)])
    hub = np.column_stack([np.zeros(n - 1, int)] + [np.arange(1, n)] * 3)
    return Graph.build(rng.normal(size=(n, 3)) * 10, np.concatenate([cells, hub]), device)


def random_layer(width, heads, device="cpu"):
    """A layer whose biases are not zero."""
    torch.manual_seed(0)
    layer = Attention(width, heads)
    with torch.no_grad():
        for weight in layer.parameters():
            weight.add_(0.1 * torch.randn_like(weight))
    return layer.to(device)


def results(forward, layer, graph, x, weight):
    """Output, and gradients of sum(output weight) by x and the parameters."""
    start = x.clone().requires_grad_()
    out = forward(start, graph.edges, graph.attributes)
    return [out.detach(), *torch.autograd.grad((out * weight).sum(), [start, *layer.parameters()])]


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize(("width", "heads"), [(32, 4), (18, 3), pytest.param(12, 1, marks=pytest.mark.full)])
def test_compiled_layer_equals_torch_geometric(width, heads, device):
    graph, layer = random_graph(device=device), random_layer(width, heads, device)
    x, weight = torch.randn(2, 40, width, device=device)
    compiled = results(layer, layer, graph, x, weight)
    general = results(layer.general, layer, graph, x, weight)
    for mine, theirs in zip(compiled, general, strict=True):
        assert (mine - theirs).norm() < 1e-5 * theirs.norm()


def test_the_layer_starts_as_torch_geometrics_does():
    torch.manual_seed(4)
    theirs = GATv2Conv(24, 8, 3, edge_dim=4, add_self_loops=False)
    torch.manual_seed(4)
    ours = dict(Attention(24, 3).named_parameters())
    assert ours.keys() == dict(theirs.named_parameters()).keys()
    assert all(torch.equal(ours[name], weight) for name, weight in theirs.named_parameters())
    graph, x = random_graph(), torch.randn(40, 24)
    theirs.load_state_dict(random_layer(24, 3).state_dict())
    expected = x + torch.nn.functional.gelu(theirs(x, graph.edges, graph.attributes))
    assert torch.equal(random_layer(24, 3).general(x, graph.edges, graph.attributes), expected)


@pytest.mark.parametrize("device", DEVICES)
def test_compiled_layer_gives_the_same_bits_again(device):
    graph, layer = random_graph(device=device), random_layer(32, 4, device)
    x, weight = torch.randn(2, 40, 32, device=device)
    first, again = (results(layer, layer, graph, x, weight) for _ in range(2))
    assert all(torch.equal(a, b) for a, b in zip(first, again, strict=True))


def test_threads_do_not_change_a_bit():
    rng = np.random.default_rng(0)
    cells = np.column_stack([np.arange(2000)] + [rng.integers(2000, size=2000) for _ in range(3)])
    graph, layer = Graph.build(rng.normal(size=(2000, 3)) * 10, cells), random_layer(32, 4)
    x, weight = torch.randn(2, 2000, 32)
    threads, outputs = torch.get_num_threads(), []
    try:
        for count in (1, 2, 3):
            torch.set_num_threads(count)
            outputs.append(results(layer, layer, graph, x, weight)[0])
    finally:
        torch.set_num_threads(threads)
    assert torch.equal(outputs[0], outputs[1]) and torch.equal(outputs[0], outputs[2])
    assert torch.allclose(outputs[0], layer.general(x, graph.edges, graph.attributes), atol=1e-5)


def test_other_precisions_are_served():
    graph, layer = random_graph(), random_layer(32, 4)
    x = torch.randn(40, 32)
    exact = layer.double()(x.double(), graph.edges, graph.attributes.double())
    assert exact.dtype == torch.float64
    assert torch.allclose(layer.float()(x, graph.edges, graph.attributes).double(), exact, atol=1e-5)


@pytest.mark.parametrize("device", DEVICES)
def test_attention_weights_survive_large_scores(device):
    graph, layer = random_graph(device=device), random_layer(32, 4, device)
    x = 1e4 * torch.randn(40, 32, device=device)
    out = layer(x, graph.edges, graph.attributes).double()
    exact = layer.double().general(x.double(), graph.edges, graph.attributes.double())
    assert (out - exact).norm() < 1e-5 * exact.norm()
    gradients = results(layer.float(), layer, graph, x, x)
    assert torch.isfinite(torch.stack([value.norm() for value in gradients])).all()


def test_not_a_number_is_passed_on():
    graph, layer = random_graph(), random_layer(32, 4)
    x = torch.randn(40, 32)
    x[3, 5] = float("nan")
    out = layer(x, graph.edges, graph.attributes)
    touched = graph.edges[1, graph.edges[0] == 3]
    assert out[touched].isnan().all()


def test_body_without_nodes_is_encoded():
    graph = Graph.build(np.zeros((0, 3)), np.zeros((0, 4), int))
    assert Encoder(3, 32, 4, 2)(graph.points, graph.edges, graph.attributes).shape == (0, 32)


def test_layout_belongs_to_the_edges():
    graph = random_graph()
    layout = Layout.of(graph.edges, 40)
    assert Layout.of(graph.edges, 40) is layout
    order, leaving = layout.leaving
    for node in range(40):
        assert (graph.edges[1, layout.arriving[node] : layout.arriving[node + 1]] == node).all()
        assert (graph.edges[0, order[leaving[node] : leaving[node + 1]]] == node).all()
    assert layout.arriving[-1] == leaving[-1] == graph.edges.shape[1]
    assert torch.equal(order.sort().values, torch.arange(len(order)))


@pytest.mark.parametrize("edges", [[[0, 1, 1], [0, 1, 0]], [[0, 1], [0, 0]], [[0, 2], [0, 1]], [[0, 1], [0, 2]]])
def test_edges_that_the_loops_cannot_walk_are_refused(edges):
    with pytest.raises(ValueError, match="sorted by target"):
        Layout.of(torch.tensor(edges), 2)


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


def test_boundary_network_reads_no_more_of_the_source_than_it_answers_by():
    source, pieces = Graph.build(np.random.default_rng(0).normal(size=(40, 3)), np.arange(37)[:, None] + range(4)), []
    network, near = BoundaryNetwork(network_settings()), torch.tensor([[5, 6], [5, 4]])
    network.encoder.register_forward_pre_hook(lambda _, inputs: pieces.append(inputs[0]))
    torch.nn.init.ones_(network.decoder.linear.weight)
    motion, moved, cue = torch.randn(40, 3), torch.ones(40, 1), torch.zeros(2, 3)
    answer = network(source, motion, moved, near, cue, moved[:2])
    everything = torch.cat([near, torch.arange(40).view(-1, 2)])
    whole = network(source, motion, moved, everything, torch.zeros(22, 3), torch.ones(22, 1))
    assert torch.allclose(answer, whole[:2], atol=1e-5) and answer.abs().min() > 0.1
    assert [len(features) for features in pieces] == [16, 40]  # three layers, each three nodes on
