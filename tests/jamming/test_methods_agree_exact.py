"""Facts about the verdict on small random networks: it is what a computation in whole numbers says, without rounding.

Coordinates and lattices are rational. A contact's row is taken with the branch vector v in place of the unit normal, a
positive multiple: v.(u_j - u_i) + v.e.v. A cone of motions is trivial exactly when its rows have full rank and a
strictly positive combination of them vanishes. Every answer of the exact computation comes with a witness: such a
combination and the rank modulo a prime, or a motion. The witness is put into the rows and checked.
"""

import functools
import math
from collections import Counter
from fractions import Fraction

import numpy as np
import pytest

import packmech as pm

YES, NO = "jammed", "not jammed"
PRIME = 2**61 - 1


def whole(vector):
    """Return the positive multiple of a rational vector that has whole numbers without a common factor."""
    fractions = [Fraction(x) for x in vector]
    common = math.lcm(*(x.denominator for x in fractions))
    numbers = [int(x * common) for x in fractions]
    return np.array(numbers, dtype=object) // max(math.gcd(*numbers), 1)


def pivot(table, row, column, before):
    """Return the integer table after elimination by one entry; division by the pivot before is exact (Bareiss)."""
    entry = table[row, column]
    line = table[row].copy()
    table = (table * entry - np.outer(table[:, column], line)) // before
    table[row] = line
    return table, entry


def balance(matrix, right):
    """Return (x, None) with matrix @ x = right and x >= 0, or (None, y) with y @ matrix >= 0 > y @ right.

    The first phase of the simplex method in whole numbers, by Bland's rule, so that it ends.
    """
    rows, columns = matrix.shape
    sign = np.array([-1 if value < 0 else 1 for value in right], dtype=object)
    unit = np.array([[int(i == j) for j in range(rows)] for i in range(rows)], dtype=object).reshape(rows, rows)
    table = np.hstack([matrix * sign[:, None], unit, (right * sign)[:, None]])
    cost = -table.sum(axis=0)
    cost[columns : columns + rows] = 0
    table, basis, scale = np.vstack([table, cost]), list(range(columns, columns + rows)), 1
    while table[-1, -1] != 0:
        falling = [j for j in range(columns) if table[-1, j] < 0]
        if not falling:
            # what is left of the cost in the columns of the slacks is 1 - y
            y = (table[-1, columns : columns + rows] - scale) * sign
            assert (y @ matrix >= 0).all() and y @ right < 0
            return None, y
        enter, leave = falling[0], None
        for i in (i for i in range(rows) if table[i, enter] > 0):
            if leave is not None:
                less = table[i, -1] * table[leave, enter] - table[leave, -1] * table[i, enter]
            if leave is None or less < 0 or (less == 0 and basis[i] < basis[leave]):
                leave = i
        table, scale = pivot(table, leave, enter, scale)
        basis[leave] = enter
    x = np.array([Fraction(0)] * columns, dtype=object)
    for i in (i for i in range(rows) if basis[i] < columns):
        x[basis[i]] = Fraction(table[i, -1], scale)
    assert (matrix @ x == right).all() and (x >= 0).all()
    return x, None


def rank_modulo(matrix):
    """Return the rank over the numbers modulo a prime: never above the rank over the rational numbers."""
    rows, rank = matrix % PRIME, 0
    for column in range(matrix.shape[1]):
        found = next((k for k in range(rank, len(rows)) if rows[k, column]), None)
        if found is None:
            continue
        rows[[rank, found]] = rows[[found, rank]]
        factor = rows[rank + 1 :, column] * pow(rows[rank, column], -1, PRIME)
        rows[rank + 1 :] = (rows[rank + 1 :] - np.outer(factor, rows[rank])) % PRIME
        rank += 1
    return rank


def null_space(matrix):
    """Return a basis, one row for each, of the vectors y with matrix @ y = 0; that they are all is checked too."""
    table, scale, pivots, columns = matrix.copy(), 1, {}, matrix.shape[1]
    for column in range(columns):
        found = next((i for i in range(len(table)) if i not in pivots and table[i, column] != 0), None)
        if found is not None:
            table, scale = pivot(table, found, column, scale)
            pivots[found] = column
    basis = np.zeros((columns - len(pivots), columns), dtype=object)
    for y, column in zip(basis, sorted(set(range(columns)) - set(pivots.values())), strict=True):
        y[column] = scale
        for i, j in pivots.items():
            y[j] = -table[i, column]
        assert not (matrix @ y).any()
    assert rank_modulo(matrix) == len(pivots)
    return basis


def is_trivial(one_sided, held):
    """Return whether only y = 0 has one_sided @ y >= 0 and held @ y = 0, by witnesses that are checked."""
    if one_sided.shape[1] == 0:
        return True
    if len(null_space(np.vstack([one_sided, held]))):
        return False
    # weights of at least one on every one-sided row
    x, y = balance(np.hstack([one_sided.T, held.T, -held.T]), -one_sided.sum(axis=0))
    if x is None:
        opening = one_sided @ y
        assert (opening >= 0).all() and opening.sum() > 0 and not (held @ y).any()
        return False
    count, less = len(one_sided), len(held)
    weight, multiplier = x[:count] + 1, x[count : count + less] - x[count + less :]
    assert (weight >= 1).all() and not (weight @ one_sided + multiplier @ held).any()
    return True


def carrying(rows):
    """Return which rows take part in a combination with nonnegative weights that vanishes."""
    chosen = np.arange(len(rows))
    while len(chosen):
        x, y = balance(rows[chosen].T, -rows[chosen].sum(axis=0))
        if x is not None:
            break
        chosen = chosen[(rows[chosen] @ y) == 0]
    return chosen


class TiedError(Exception):
    """Two groups are the largest, and not alike: which of them is the backbone is nobody's to say."""


class Network:
    """Particles at rational places in a rational lattice, and pairs (i, j, image) that count as contacts."""

    def __init__(self, place_nd, lattice_dd, pairs):
        self.place, self.lattice, self.pairs = place_nd, lattice_dd, pairs

    def vector(self, pair):
        i, j, image = pair
        return self.place[j] - self.place[i] + self.lattice @ np.array(image, dtype=object)

    def rows(self, pairs, strain):
        """Return one row for every pair, on motions of the particles that have contacts, the first of them held."""
        d = len(self.lattice)
        moving = sorted({k for i, j, _ in pairs for k in (i, j)})[1:]
        axes = [(a, b) for a in range(d) for b in range(a, d)] if strain else []
        matrix = np.zeros((len(pairs), len(moving) * d + len(axes)), dtype=object)
        for c, pair in enumerate(pairs):
            v, row = self.vector(pair), np.full(matrix.shape[1], Fraction(0), dtype=object)
            for end, sign in ((pair[0], -1), (pair[1], 1)):
                if end in moving:
                    k = moving.index(end) * d
                    row[k : k + d] += sign * v
            row[len(moving) * d :] = [v[a] * v[b] * (1 if a == b else 2) for a, b in axes]
            matrix[c] = whole(row)
        growth = np.zeros((1, matrix.shape[1]), dtype=object)
        growth[0, len(moving) * d :] = [-int(a == b) for a, b in axes]
        return matrix, growth if strain else growth[:0]

    def held(self, pairs):
        """Return the pairs without those of particles that their neighbors do not hold, one by one."""
        none = np.zeros((0, len(self.lattice)), dtype=object)
        while True:
            loose = set()
            for k in {k for i, j, _ in pairs for k in (i, j)}:
                out = [whole(s * self.vector(p)) for p in pairs for s, end in ((1, p[0]), (-1, p[1])) if end == k]
                if not is_trivial(np.array(out, dtype=object), none):
                    loose.add(k)
            kept = [pair for pair in pairs if not loose & set(pair[:2])]
            if len(kept) == len(pairs):
                return pairs
            pairs = kept

    def groups(self, pairs):
        """Return the largest sets of particles that stand to one another in all motions that change no given pair."""
        d, moving = len(self.lattice), sorted({k for i, j, _ in pairs for k in (i, j)})
        motion = null_space(self.rows(pairs, strain=False)[0])
        # the first particle is held
        motion = np.hstack([np.zeros((len(motion), d), dtype=object), motion])
        found = {}
        for k, particle in enumerate(moving):
            found.setdefault(tuple(motion[:, k * d : (k + 1) * d].ravel()), []).append(particle)
        most = max(map(len, found.values()))
        return [set(group) for group in found.values() if len(group) == most]

    def answers(self, strain, pairs=None):
        """Return whether it is collectively and strictly jammed, rattlers taken out.

        While the rest is not jammed, what carries no force or does not move with the largest group is taken out too.
        """
        pairs = self.held(self.pairs if pairs is None else pairs)
        if not pairs:
            return NO, NO
        rows, none = self.rows(pairs, strain=False)
        if is_trivial(rows, none):
            rows, growth = self.rows(pairs, strain=True)
            one_sided, held = (rows, growth) if strain == "isochoric" else (np.vstack([rows, growth]), growth[:0])
            return YES, YES if is_trivial(one_sided, held) else NO
        chosen = [pairs[c] for c in carrying(rows)]
        if not chosen:
            return NO, NO
        parts = [[pair for pair in chosen if set(pair[:2]) <= group] for group in self.groups(chosen)]
        found = {self.answers(strain, part) if len(part) < len(pairs) else (NO, NO) for part in parts}
        if len(found) > 1:
            raise TiedError
        return found.pop()

    def floating(self):
        """Return the same as a packing of small particles and its contacts."""
        place, lattice = self.place.astype(float), self.lattice.astype(float)
        packing = pm.Packing(place, np.full(len(place), 1e-9), pm.Box(lattice))
        pairs = sorted(self.pairs)
        vector = np.array([self.vector(pair) for pair in pairs]).astype(float).reshape(-1, len(lattice))
        distance = np.sqrt((vector**2).sum(axis=1))
        i, j, image = ([pair[k] for pair in pairs] for k in range(3))
        ends = np.array([i, j], dtype=np.int64)
        image = np.array(image, dtype=np.int64).reshape(-1, len(lattice))
        kinds, sizes = np.zeros(len(distance), dtype=np.int64), (len(place), len(lattice))
        return packing, pm.Contacts(
            *ends, image, vector / distance[:, None], distance, distance, 0.25 * distance, kinds, *sizes
        )


def random_pairs(rng, particles, d, count):
    """Return different pairs, some of a particle with its own image, each once."""
    pairs = set()
    while len(pairs) < count:
        i, j = sorted(rng.integers(particles, size=2).tolist())
        image = rng.integers(-1, 2, d).tolist()
        if i == j:
            if not any(image):
                continue
            first = next(z for z in image if z)
            image = [z * first for z in image]
        pairs.add((i, j, tuple(image)))
    return sorted(pairs)


def balanced_places(rng, particles, lattice, pairs):
    """Return rational places at which random positive weights of the pairs balance, and the weights."""
    weight = [int(x) for x in rng.integers(1, 4, len(pairs))]
    laplacian = np.zeros((particles, particles), dtype=object)
    pull = np.full((particles, len(lattice)), Fraction(0), dtype=object)
    for (i, j, image), w in zip(pairs, weight, strict=True):
        shift = lattice @ np.array(image, dtype=object)
        laplacian[i, i], laplacian[j, j] = laplacian[i, i] + w, laplacian[j, j] + w
        laplacian[i, j], laplacian[j, i] = laplacian[i, j] - w, laplacian[j, i] - w
        pull[i] += w * shift
        pull[j] -= w * shift
    # the first particle stays at the origin: its equation gives way
    laplacian[0], pull[0] = 0, 0
    laplacian[0, 0] = 1
    table = np.hstack([laplacian, pull])
    for k in range(particles):
        found = next((i for i in range(k, particles) if table[i, k] != 0), None)
        if found is None:
            return None, weight
        table[[k, found]] = table[[found, k]]
        table[k] = table[k] * Fraction(1, table[k, k])
        for i in range(particles):
            if i != k:
                table[i] = table[i] - table[i, k] * table[k]
    return table[:, particles:], weight


def with_isotropic_stress(rng, network, weight):
    """Return the network with pairs of particles and their own images that turn its stress into a pressure.

    The lattice must be the unit one.
    """
    d, extra = len(network.lattice), {}
    stress = sum(w * np.outer(v, v) for w, v in zip(weight, map(network.vector, network.pairs), strict=True))
    for a in range(d):
        for b in range(a):
            if stress[a, b]:
                image = [0] * d
                image[b], image[a] = 1, -1 if stress[a, b] > 0 else 1
                extra[tuple(image)] = abs(stress[a, b])
    total = stress + sum(w * np.outer(z, z) for z, w in extra.items())
    assert all(total[a, b] == 0 for a in range(d) for b in range(a))
    for a in range(d):
        if total[a, a] < max(np.diag(total)):
            extra[tuple(int(a == b) for b in range(d))] = 1
    # at the same particle as one that is there already, the pair counts once: another weight, the same network
    where = rng.integers(len(network.place), size=len(extra)).tolist()
    pairs = set(network.pairs) | {(k, k, z) for k, z in zip(where, extra, strict=True)}
    return Network(network.place, network.lattice, sorted(pairs))


def quarters(numbers):
    return np.vectorize(lambda x: Fraction(int(x), 4), otypes=[object])(numbers)


KINDS = ["random", "planted", "planted isotropic", "planted less one", "isotropic less one"]


@functools.cache
def network(number):
    """Return the network of that number, and its answers: kinds, dimensions and densities take turns."""
    rng = np.random.default_rng(number)
    kind, d = KINDS[number % len(KINDS)], 2 + number // len(KINDS) % 2
    density = (0.7, 1.0, 1.3, 2.0, 3.0)[number // (2 * len(KINDS)) % 5]
    while True:
        particles = int(rng.integers(1, 9))
        count = max(1, round(density * (d * (particles - 1) + 1)))
        if count > particles**2 * 3**d // 4:
            continue
        pairs = random_pairs(rng, particles, d, count)
        lattice = np.array([[Fraction(int(i == j)) for j in range(d)] for i in range(d)], dtype=object)
        if "isotropic" not in kind:
            lattice = lattice + quarters(rng.integers(-1, 2, (d, d)))
            if np.linalg.det(lattice.astype(float)) < 0.2:
                continue
        if kind == "random":
            place, weight = quarters(rng.integers(12, size=(particles, d))) / 3, []
        else:
            place, weight = balanced_places(rng, particles, lattice, pairs)
        if place is None:
            continue
        found = Network(place, lattice, pairs)
        if not all(any(found.vector(pair)) for pair in pairs):
            continue
        if "isotropic" in kind:
            found = with_isotropic_stress(rng, found, weight)
        if "less one" in kind:
            gone = int(rng.integers(len(found.pairs)))
            found = Network(place, lattice, found.pairs[:gone] + found.pairs[gone + 1 :])
        try:
            return found, {strain: found.answers(strain) for strain in ("free", "isochoric")}
        except TiedError:
            continue


BOUNDED = ["clarabel ball", "clarabel box", "highs box"]
FAST = ["certificate clarabel ball", "certificate highs ball", *(f"loads {way}" for way in BOUNDED)]
READABLE = ["certificate cvxpy ball", "loads cvxpy ball", "loads cvxpy box"]
NETWORKS = 200
SOME = range(0, NETWORKS, 7)


def assert_all_ways_agree(number, ways):
    found, expected = network(number)
    packing, contacts = found.floating()
    for strain, answers in expected.items():
        for way in ways:
            how = dict(zip(("method", "solver", "bound"), way.split(), strict=True)) | {"strain": strain}
            verdict = pm.classify_jamming(packing, contacts=contacts, **how)
            assert (verdict.collective, verdict.strict) == answers, how


@pytest.mark.parametrize("number", SOME)
def test_small_network_is_what_whole_numbers_say_by_every_fast_method(number):
    assert_all_ways_agree(number, FAST)


@pytest.mark.parametrize("number", SOME[::6])
def test_small_network_is_what_whole_numbers_say_by_the_programs_as_they_read(number):
    assert_all_ways_agree(number, READABLE)


@pytest.mark.slow
@pytest.mark.parametrize("number", range(NETWORKS))
def test_each_of_200_small_networks_is_what_whole_numbers_say_by_every_method(number):
    assert_all_ways_agree(number, FAST + READABLE)


@pytest.mark.parametrize("numbers", [SOME, pytest.param(range(NETWORKS), marks=pytest.mark.slow)], ids=["some", "all"])
def test_no_answer_is_rare_among_the_networks_and_own_images_are_among_the_contacts(numbers):
    answers, own, planes = Counter(), 0, Counter()
    for number in numbers:
        found, expected = network(number)
        answers[expected["free"]] += 1
        own, planes[len(found.lattice)] = own + any(i == j for i, j, _ in found.pairs), planes[len(found.lattice)] + 1
    print(f"collective and strict: {dict(answers)}; with own images: {own}; dimensions: {dict(planes)}")
    assert set(answers) == {(YES, YES), (YES, NO), (NO, NO)}
    assert min(*answers.values(), *planes.values(), own) >= 0.1 * len(numbers)


@pytest.mark.parametrize(
    ("repeats", "expected"), [((1, 1), (YES, NO)), ((2, 1), (NO, NO)), ((1, 1, 1), (YES, NO)), ((1, 1, 2), (NO, NO))]
)
def test_whole_numbers_give_the_published_answers_for_square_and_cubic_crystals(repeats, expected):
    d = len(repeats)
    cells = list(np.ndindex(*repeats))
    pairs = set()
    for i, cell in enumerate(cells):
        for axis in range(d):
            beyond = [x + (a == axis) for a, x in enumerate(cell)]
            j = cells.index(tuple(x % m for x, m in zip(beyond, repeats, strict=True)))
            image = tuple(x // m for x, m in zip(beyond, repeats, strict=True))
            pairs.add((i, j, image) if i <= j else (j, i, tuple(-z for z in image)))
    place = np.array([[Fraction(x) for x in cell] for cell in cells], dtype=object)
    lattice = np.array([[Fraction(m * (i == j)) for j in range(d)] for i, m in enumerate(repeats)], dtype=object)
    crystal = Network(place, lattice, sorted(pairs))
    assert crystal.answers("free") == crystal.answers("isochoric") == expected
