"""Keeps Python's collector of reference cycles from stopping the loop: nothing is answered while it runs."""

import gc


def settle() -> None:
    """Set aside all that is in use now, so that later collections pass over it.

    What is there after the start stays: modules, the parts of the gateway. A full collection walks over all of it,
    every time many clients have come, which takes 15 ms; the clients of a full house are 1 ms of that. Once more after
    a reload, or its old parts would never be freed. This itself is a full collection.
    """
    gc.unfreeze()
    gc.collect()
    gc.freeze()
