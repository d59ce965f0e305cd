"""Keeps pauses by Python's garbage collector short: nothing is answered while it runs."""

import gc


def settle() -> None:
    """Exclude all present objects from later collections.

    Objects that exist after the start stay: modules, the parts of the gateway. Each full collection, after many clients
    have connected, would traverse them, which takes 15 ms; the clients of full listeners are 1 ms of that. To be called
    again after a reload, otherwise its old parts would never be freed. This call is a full collection itself.
    """
    gc.unfreeze()
    gc.collect()
    gc.freeze()
