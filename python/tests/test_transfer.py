"""Transfer functions: what they show, and that they come back from JSON, pickles and files."""

import copy
import pickle

import numpy as np
import pytest

import adjsplat as adj
from adjsplat import TransferFunction

FUNCTIONS = [
    TransferFunction.range(60),
    TransferFunction.range(None, 10.5, opacity=0.25),
    TransferFunction.contour(100, colour="#ff0000", cap="above"),
    TransferFunction.points([(1, "#000000", 0), (2, (0.1, 0.2, 0.3), 1)], gradient=[(0, 0.5), (10, 1)], shaded=False),
    TransferFunction.labels({1: "#ff0000", 2: ("two", (0, 1, 0), 0.5)}, others="distinct"),
    TransferFunction.labels(),
    TransferFunction.preset("ct-bone+1024"),
    TransferFunction(
        {
            "kind": "region",
            "knots": [
                {"value": np.float32(v), "colour": np.array([1.0, v / 100, 0.0]), "opacity": np.float64(0.5)}
                for v in (0, 50, 100)
            ],
        }
    ),
]


def test_a_ramp_may_be_an_array():
    points, ramp = [(1, "#000000", 0), (2, "#ffffff", 1)], [(0, 0.5), (10, 1)]
    assert TransferFunction.points(points, gradient=np.array(ramp)) == TransferFunction.points(points, gradient=ramp)


@pytest.mark.parametrize("function", FUNCTIONS, ids=lambda function: function.kind)
def test_functions_come_back(function, tmp_path):
    assert TransferFunction.from_json(function.to_json()) == function
    assert TransferFunction(function.to_dict()) == function
    assert pickle.loads(pickle.dumps(function)) == function == copy.deepcopy(function)
    assert len({function, copy.copy(function)}) == 1 and "TransferFunction({" in repr(function)
    path = tmp_path / "function.json"
    path.write_text(function.to_json())
    assert TransferFunction.read(path) == function


def test_points_are_interpolated():
    f = TransferFunction.points([(10, "#000000", 0), (20, "#ffffff", 0.5)])
    assert np.allclose(f.opacity([[5, 10], [15, 40]]), [[0, 0], [0.25, 0.5]])
    assert f.colour([20, 40]).tolist() == [[1, 1, 1], [1, 1, 1]] and f.colour(20).shape == (3,)


def test_a_function_differs_from_others():
    assert TransferFunction.range(60) != TransferFunction.range(61) and TransferFunction.range(60) != 60


@pytest.mark.parametrize(
    "opacity", ["linear", "linear_r", "geom", "geom_r", "sigmoid", "sigmoid_r", 0.3, [0, 1, 0]], ids=str
)
def test_colour_maps_of_matplotlib(opacity):
    matplotlib = pytest.importorskip("matplotlib")
    f = TransferFunction.from_matplotlib("magma", (100, 200), opacity=opacity)
    share = np.linspace(0, 1, 11)
    want = {
        "linear": share,
        "linear_r": 1 - share,
        "geom": share**2,
        "geom_r": (1 - share) ** 2,
        "sigmoid": 1 / (1 + np.exp(-10 * (2 * share - 1))),
        "sigmoid_r": 1 / (1 + np.exp(10 * (2 * share - 1))),
        "0.3": np.full(11, 0.3),
        "[0, 1, 0]": 1 - np.abs(2 * share - 1),
    }[str(opacity)]
    # Between 64 points the shapes are nearly straight, and what is fainter than 1/255 is nothing.
    assert np.abs(f.opacity(100 + 100 * share) - want).max() < 0.02
    assert f.opacity(99.999) == 0
    from adjsplat.pictures import _decoded

    exact = _decoded(matplotlib.colormaps["magma"](np.linspace(0, 1, 64))[:, :3])
    assert np.abs(f.colour(100 + 100 * np.linspace(0, 1, 64)) - exact).max() < 1e-3
    assert TransferFunction.from_matplotlib(matplotlib.colormaps["magma"], (100, 200), opacity=opacity) == f


def test_a_peak_in_a_list_of_opacities_stays():
    pytest.importorskip("matplotlib")
    for count in (5, 64, 200, 1000):
        opacities = np.zeros(count)
        opacities[count // 3] = 1
        f = TransferFunction.from_matplotlib("magma", (0, count - 1), opacity=list(opacities))
        assert np.abs(f.opacity(np.arange(count)) - opacities).max() < 1e-9


@pytest.mark.parametrize(
    ("make", "error"),
    [
        (lambda: TransferFunction.range(5, 1), ValueError),
        (lambda: TransferFunction.range(float("nan")), ValueError),
        (lambda: TransferFunction.points([]), ValueError),
        (lambda: TransferFunction.points([(2, "#000000", 0), (1, "#000000", 1)]), ValueError),
        (lambda: TransferFunction.points([(1, "#00000", 0)]), ValueError),
        (lambda: TransferFunction.points([(1, (1, 2), 0)]), ValueError),
        (lambda: TransferFunction.points([(1, "#000000", 1.5)]), ValueError),
        (lambda: TransferFunction.points([(float("inf"), "#000000", 1)]), ValueError),
        (lambda: TransferFunction.labels({1: "#000000"}, others="some"), ValueError),
        (lambda: TransferFunction.contour(1, cap="left"), ValueError),
        (lambda: TransferFunction.preset("bone"), ValueError),
        (lambda: TransferFunction.from_json("{"), ValueError),
        (lambda: TransferFunction.from_json('{"kind": "range", "lo": 3}'), ValueError),
        (lambda: TransferFunction({"kind": "range", "low": 1j}), TypeError),
        (lambda: TransferFunction.read("/nonexistent/function.json"), FileNotFoundError),
        (lambda: TransferFunction.from_matplotlib("magma", (2, 1)), ValueError),
        (lambda: TransferFunction.from_matplotlib("magma", (0, float("inf"))), ValueError),
        (lambda: TransferFunction.from_matplotlib("magma", (0, 1), opacity="steep"), ValueError),
        (lambda: TransferFunction.from_matplotlib("magma", (0, 1), opacity=[0, 2]), ValueError),
        (lambda: TransferFunction.from_matplotlib("magma", (0, 1), samples=1), ValueError),
        (lambda: adj.build(np.ones((2, 2, 2)), transfer=5), TypeError),
    ],
)
def test_what_is_no_function_raises(make, error):
    with pytest.raises(error):
        make()
