from __future__ import annotations

import re

from hypothesis import assume, given
from hypothesis import strategies as st

from service.dataset_keys import check_key, key_of, path_of
from service.engine.errors import InvalidParameter

KEYS = st.lists(st.text("aB7.=-_~%#ä()json ", min_size=1, max_size=6), min_size=1, max_size=3).map("/".join)


@given(KEYS, KEYS)
def test_a_key_is_found_again_and_shares_its_place_with_no_other(first: str, second: str) -> None:
    try:
        keys = [check_key(first), check_key(second)]
    except InvalidParameter:
        assume(False)
    one, other = (path_of(key) for key in keys)
    assert (key_of(one), key_of(other)) == (first, second)
    assert re.fullmatch(r"[A-Za-z0-9._=/-]+", one)
    assert not other.startswith(f"{one}/")
    assert (one == other) == (first == second)


def test_what_is_beside_the_entries_is_no_key() -> None:
    assert key_of("notes.txt") is None
    assert key_of("a.json") is None
