"""The last result is kept for the same input and for no other."""

import gc
from weakref import ref

import numpy as np

from paperrepro.method.adjustment import screening


def test_an_array_of_the_same_values_is_asked_once():
    asked = []
    function = screening.for_array(lambda x: asked.append(x.copy()) or 2 * x)
    for values in ([1.0, 2.0], [1.0, 2.0], [1.0, 3.0], [1.0, 2.0]):
        np.testing.assert_array_equal(function(np.array(values)), 2 * np.array(values))
    assert len(asked) == 3


class Thing:
    pass


def test_the_same_two_objects_are_asked_once():
    asked = []

    @screening.for_objects
    def function(one, other):
        asked.append(1)
        return id(one), id(other)

    one, other = Thing(), Thing()
    assert function(one, other) == function(one, other) == (id(one), id(other))
    assert len(asked) == 1
    assert function(other, one) == (id(other), id(one))
    assert len(asked) == 2


def test_objects_are_not_kept_alive():
    function = screening.for_objects(lambda one, other: 3)
    one, other = Thing(), Thing()
    watched = ref(one)
    assert function(one, other) == 3
    del one
    gc.collect()
    assert watched() is None
    assert function(Thing(), other) == 3
