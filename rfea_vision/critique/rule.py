"""The one rule by which effects are accepted: evidence under a model that admits a structured remainder.

No law of a catalogue is that of a real tube. So every set of effects S, the empty one too, leaves a discrepancy d(t, place)
with a size and correlation of its own (Kennedy and O'Hagan 2001, doi:10.1111/1467-9868.00294; Brynjarsdottir and O'Hagan
2014, doi:10.1088/0266-5611/30/11/114007). With its size integrated out, n independent values of it weigh

    log evidence(S) = -n/2 mean over runs of log(X(S) + r^2 + f^2 (X(base) - X(S))) - price(S)

X is the squared error above the irreproducible floor on a run, and r what cannot be resolved of it. Training and held-out
runs count half each. Only the ratio of remainders counts: a large remainder makes every claim weaker, a small one sharper, but for
this: a law of the catalogue is right to a share f of the motion that it makes. So f^2 of what the set has taken away of X since the
base model is added to r^2, lest a second effect is called for by the errors of the first one's form.

`n` is not the number of frames. Neighbouring values are correlated, which leaves n_c of them (frames over the correlation time
of the residual); and a discrepancy is a fault of the law, the same in every run, of which a longer record tells no more:
the log of what a true law in another form leaves scatters by 2 / n_s from one tube to the next. Variances add: 1/n = 1/n_c + 1/n_s.

Two things no evidence among the sets can tell: a cause outside of the catalogue that moves the tube as an effect of it does (of few
effects a well-known one: a side wind is a tilted gravity), and an effect that is there and too weak to be worth a refit. Both
are shares, counted.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rfea_vision.critique.measures import MATTERS_FLOORS


@dataclass(frozen=True)
class Rule:
    """The numbers of the rule: all there are.

    ============ ======= ===============================================================================================
    independent  n_s     both chosen on 156 campaigns of two plants, whose every refit stands in benchmarks/probabilities: without f,
    form         f       each larger n_s finds more and is wrong more often above 0.9; with it, 12 finds as much as 8 without, and
                         is half as often wrong there (benchmarks/probability_sweep.py, docs/critique.md)
    outside      -       probability that stays with causes outside of the catalogue, and of an effect that nothing speaks for:
    unseen       -       by Laplace's rule of succession, of strong claims on those campaigns and of faint ones
    imitated     -       probability that stays with the cause outside that an effect's file says to imitate it: by the same rule, of
                         such claims above 0.9 (gravity_tilt, or a tie with it) in all counts so far, of which 32 of 44 were right
    resolution   r       floors; what docs/formats.md calls too little to matter
    expected     -       effects missing from a model before anything was seen: one, which the catalogue's K share
    likely       -       a half: the probability from which an effect is named, by docs/formats.md
    ============ ======= ===============================================================================================
    """

    independent: float = 12.0
    form: float = 0.05
    outside: float = 0.03
    imitated: float = 0.28
    unseen: float = 0.01
    resolution: float = MATTERS_FLOORS
    expected: float = 1.0
    likely: float = 0.5

    def count(self, correlated: float) -> float:
        """Independent values of a discrepancy, of which `correlated` could be told apart in the record."""
        return 1 / (1 / correlated + 1 / self.independent)

    def price(self, effects: int, catalogue: int) -> float:
        """Log of the prior odds against so many effects of the catalogue's."""
        return effects * float(np.log(catalogue / self.expected))

    def evidence(
        self,
        excess: Mapping[str, float],
        whole: Mapping[str, float],
        roles: Mapping[str, str],
        room: float,
        count: float,
    ) -> float:
        """Log evidence before the price: excess is the squared error above the floor by run, of which room^2 is not told apart.

        `whole` is that of the base model.
        """
        groups: dict[bool, list[float]] = {}
        for name, value in excess.items():
            left = max(value, 0.0)
            explained = max(whole.get(name, left) - left, 0.0)
            alike = room**2 + self.form**2 * explained
            groups.setdefault(roles[name] == "train", []).append(float(np.log(left + alike + 1e-300)))
        return -0.5 * count * float(np.mean([np.mean(values) for values in groups.values()]))

    def posterior(self, log_weights: Sequence[float]) -> list[float]:
        """Probabilities of the sets from the logs of their weights; the rest up to one belongs to causes outside of the catalogue."""
        weights = np.exp(np.asarray(log_weights) - np.max(log_weights))
        return ((1 - self.outside) * weights / weights.sum()).tolist()

    def told(self, sets: Iterable[tuple[float, bool]]) -> float:
        """Probability that an effect, or a member of its tie, is there.

        From the probability of every set that holds one of them, and whether a cause outside of the catalogue imitates that one.
        """
        left = (1 - self.imitated) / (1 - self.outside)
        return self.unseen + (1 - self.unseen) * sum(left * p if imitated else p for p, imitated in sets)


RULE = Rule()

__all__ = ["RULE", "Rule"]
