"""A few hundred damaged and made up files: a number that is right, or one sentence (``benchmarks/fuzzing.py`` runs 22,000)."""

from __future__ import annotations

from benchmarks.fuzzing import MOST_S, fuzz


def test_whatever_a_file_holds_is_read_or_refused_in_a_sentence():
    found = fuzz(400, seed=7)
    assert found.inputs >= 400 and found.accepted > 50 and found.refused > 100
    assert found.faults == []
    assert found.longest_s < MOST_S  # memory is counted by the benchmark, in a process that has run nothing else
