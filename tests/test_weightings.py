import pytest
import torch

from fusionnet.errors import InputError
from fusionnet.training import weightings
from fusionnet.training.conflict import gradient_cosines, shared_parameters
from fusionnet.training.loop import LoopConfig, fit

NAMES = ("first", "second")


class Point(torch.nn.Module):
    """Two losses that pull one point to two places, one of them a hundred times as hard."""

    def __init__(self):
        super().__init__()
        self.place = torch.nn.Parameter(torch.tensor([1.0, 1.0]))

    def losses(self, _):
        first = (self.place - torch.tensor([1.0, 0.0])).square().sum()
        second = 100 * (self.place - torch.tensor([0.0, 0.0])).square().sum()
        return {"first": first, "second": second}


def batches(_):
    while True:
        yield torch.zeros(1)


def config(name: str, **changes) -> LoopConfig:
    base = {"steps": 200, "learning_rate": 0.05, "tensorboard": False, "clip": 0.0}
    weights = {"loss_weights": dict.fromkeys(NAMES, 1.0), "weighting": name}
    return LoopConfig(**(base | weights | changes))


@pytest.mark.parametrize("name", weightings.names())
def test_every_weighting_trains_to_where_no_loss_can_fall_alone(name):
    model = Point()
    primary = {"primary": "first"} if weightings.load(name)(NAMES).ordered else {}
    fit(model, batches, lambda wrapped, b: model.losses(b), config(name, **primary))
    x, y = model.place.tolist()
    assert -0.05 <= x <= 1.05 and abs(y) < 0.15  # between the two places: the Pareto set


def test_fixed_is_the_sum_of_the_gradients():
    model = Point()
    losses = torch.stack(list(model.losses(None).values()))
    weightings.load("fixed")(NAMES).differentiate(
        losses, list(model.parameters()), lambda loss: loss.backward()
    )
    assert torch.allclose(model.place.grad, torch.tensor([200.0, 202.0]))


def test_upgrad_raises_no_loss_where_the_sum_would():
    place = torch.nn.Parameter(torch.zeros(3))
    rows = torch.tensor([[-4.0, 1.0, 1.0], [6.0, 1.0, 1.0]])  # TorchJD's own example
    weightings.load("upgrad")(NAMES).differentiate(
        rows @ place, [place], lambda loss: loss.backward()
    )
    assert torch.allclose(place.grad, torch.tensor([0.2929, 1.9004, 1.9004]), atol=1e-3)
    assert (rows @ place.grad >= -1e-2).all() and (rows @ rows.sum(0)).min() < 0


def test_a_loss_with_factor_zero_is_not_learnt():
    model = Point()
    weights = {"first": 1.0, "second": 0.0}
    fit(model, batches, lambda w, b: model.losses(b), config("fixed", loss_weights=weights))
    assert torch.allclose(model.place, torch.tensor([1.0, 0.0]), atol=0.05)


def test_learned_weights_are_resumed(tmp_path):
    def run(folder, steps):
        model = Point()
        plan = config("uncertainty", steps=steps, save_every=10, log_every=10)
        constant = {"schedule": type(plan.schedule)(kind="constant")}
        plan = config("uncertainty", steps=steps, save_every=10, log_every=10, **constant)
        return fit(model, batches, lambda w, b: model.losses(b), plan, folder=folder), model

    _, whole = run(tmp_path / "whole", 20)
    run(tmp_path / "parts", 10)
    _, parts = run(tmp_path / "parts", 20)
    assert torch.equal(whole.place, parts.place)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"loss_weights": {}}, "needs to know its losses"),
        ({"weighting": "primary", "primary": "third"}, "The primary loss 'third' is not one of"),
        ({"weighting": "primary"}, "which loss is first: give --loop.primary .* first, second"),
        ({"primary": "first"}, "'upgrad' puts no loss first; received --loop.primary first"),
        ({"devices": 2}, "trains on one device, not 2"),
        ({"precision": "bf16-mixed"}, "full precision, not 'bf16-mixed'"),
        ({"loss_weights": {"first": 1.0, "other": 1.0}}, "loss_weights lacks second"),
        (
            {"loss_weights": {"first": 1.0, "second": 1.0, "third": 1.0}},
            "names third, which this network does not give",
        ),
    ],
)
def test_what_cannot_be_weighted_is_refused(changes, said, monkeypatch):
    monkeypatch.setattr("lightning.fabric.Fabric.launch", lambda self: None)
    model = Point()
    with pytest.raises(InputError, match=said):
        fit(model, batches, lambda w, b: model.losses(b), config(**{"name": "upgrad", **changes}))


@pytest.mark.parametrize("clip", [0.0, 1.0])
def test_a_training_that_diverges_says_so(clip):
    model = Point()

    def losses(wrapped, batch):
        return {n: v * float("inf") for n, v in model.losses(batch).items()}

    with pytest.raises(InputError, match="diverged at step 1: first, second"):
        fit(model, batches, losses, config("fixed", clip=clip))


def test_cosines_tell_conflict_from_agreement():
    model = Point()
    losses = model.losses(None)
    losses["third"] = -losses["first"]
    losses["none"] = torch.zeros((), requires_grad=True)
    cosines = gradient_cosines(losses, list(model.parameters()))
    assert set(cosines) == {("first", "second"), ("first", "third"), ("second", "third")}
    assert cosines["first", "third"] == pytest.approx(-1.0)
    assert 0 < cosines["first", "second"] < 1


def test_only_what_both_losses_reach_counts():
    one, other, third = (torch.nn.Parameter(torch.tensor([1.0, 0.0])) for _ in range(3))
    losses = {
        "a": one.sum() + 100 * other.sum(),
        "b": (one * torch.tensor([1.0, -1.0])).sum() + 100 * third.sum(),
        "c": third.sum(),
    }
    cosines = gradient_cosines(losses, [one, other, third])
    assert set(cosines) == {("a", "b"), ("b", "c")}
    assert cosines["a", "b"] == pytest.approx(0.0)  # the two large apart gradients do not count
    assert cosines["b", "c"] == pytest.approx(1.0)
    counts = shared_parameters(losses, [one, other, third])
    assert counts == {("a", "b"): 2, ("a", "c"): 0, ("b", "c"): 2}
