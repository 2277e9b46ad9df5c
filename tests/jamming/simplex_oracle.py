"""Whether a packing is jammed, written down from the definition and decided by HiGHS' simplex method alone.

Nothing of the package's own programs, ranks or rattlers is used: rows are built from branch vectors, the linear program
is passed to HiGHS by its own interface, its status, its primal and its dual solution are checked, ranks come from dense
eigenvalues. The backbone is the largest group of particles that stand to one another in all motions that change no
force-bearing contact and no link, after particles that their contacts do not hold were taken out; it is jammed when all
force-bearing contacts lie within it.
"""

import numpy as np
import scipy.sparse as sp

RANK = 1e-10


def strain_part(normal, length):
    """Return the change of each length by the strains xx, xy, ... of a box: length n.e.n."""
    d = normal.shape[1]
    return np.stack(
        [length * normal[:, a] * normal[:, b] * (1 + (a != b)) for a in range(d) for b in range(a, d)], axis=1
    )


def rows_of(i, j, vector, particles, strain):
    """Return the change of each distance by all displacements, particle by particle, and by strains if asked for."""
    count, d = vector.shape
    length = np.sqrt((vector**2).sum(axis=1))
    normal = vector / length[:, None]
    line = np.repeat(np.arange(count), d)
    axis = np.tile(np.arange(d), count)
    shape = (count, particles * d)
    ends = [(np.repeat(end, d) * d + axis, sign * normal.ravel()) for end, sign in ((j, 1.0), (i, -1.0))]
    rows = sum(sp.csr_array((value, (line, column)), shape=shape) for column, value in ends)
    return sp.csr_array(sp.hstack([rows, strain_part(normal, length)])) if strain else sp.csr_array(rows)


def open_most(contact, growth, held):
    """Return the largest sum of openings o with rows @ y >= o, 0 <= o <= 1, held @ y = 0, and which rows carry force.

    The program's status, the feasibility of both solutions, and the equality of their values are checked.
    """
    import highspy

    rows = sp.vstack([contact, growth], format="csr")
    count, size = rows.shape
    matrix = sp.csc_array(
        sp.vstack([sp.hstack([rows, -sp.eye_array(count)]), sp.hstack([held, sp.csr_array((held.shape[0], count))])])
    )
    lp = highspy.HighsLp()
    lp.num_col_, lp.num_row_ = size + count, matrix.shape[0]
    lp.col_cost_ = np.concatenate([np.zeros(size), -np.ones(count)])
    lp.col_lower_ = np.concatenate([np.full(size, -highspy.kHighsInf), np.zeros(count)])
    lp.col_upper_ = np.concatenate([np.full(size, highspy.kHighsInf), np.ones(count)])
    lp.row_lower_ = np.zeros(matrix.shape[0])
    lp.row_upper_ = np.concatenate([np.full(count, highspy.kHighsInf), np.zeros(held.shape[0])])
    lp.a_matrix_.format_ = highspy.MatrixFormat.kColwise
    lp.a_matrix_.start_, lp.a_matrix_.index_, lp.a_matrix_.value_ = matrix.indptr, matrix.indices, matrix.data
    # dual simplex first; where its last digits leave it at "unknown", primal simplex, then coarser tolerances
    for strategy, tolerance in ((1, 1e-9), (4, 1e-9), (1, 1e-7)):
        solver = highspy.Highs()
        for option, value in (("output_flag", False), ("solver", "simplex"), ("threads", 1)):
            solver.setOptionValue(option, value)
        solver.setOptionValue("simplex_strategy", strategy)
        solver.setOptionValue("primal_feasibility_tolerance", tolerance)
        solver.setOptionValue("dual_feasibility_tolerance", tolerance)
        solver.passModel(lp)
        solver.run()
        if solver.getModelStatus() == highspy.HighsModelStatus.kOptimal:
            break
    assert solver.getModelStatus() == highspy.HighsModelStatus.kOptimal, solver.getModelStatus()
    found = solver.getSolution()
    x, dual = np.array(found.col_value), np.array(found.row_dual)
    y, opened = x[:size], x[size:]
    force, multiplier = np.abs(dual[:count]), dual[count:] * np.sign(dual[:count].sum() or 1.0)
    largest = max(1.0, force.max(initial=0.0), np.abs(multiplier).max(initial=0.0))
    reach = max(1.0, np.abs(y).max(initial=0.0))
    assert (rows @ y - opened).min(initial=0.0) > -1e-7 * reach
    assert np.abs(held @ y).max(initial=0.0) < 1e-7 * reach
    assert np.abs(rows.T @ force + held.T @ multiplier).max(initial=0.0) < 1e-7 * largest
    # weak duality closes: what a row's force lacks to one is paid by its opening
    assert abs(opened.sum() - np.maximum(1.0 - force, 0.0).sum()) < 1e-6 * count
    assert (np.minimum(opened, 1.0 - opened) < 1e-6).all()
    return opened < 0.5


def is_held(normal):
    """Return whether contacts with these outward normals hold a particle while all others stay.

    If it can move, it can along an edge of the cone of its motions, where d - 1 of the contacts keep their length.
    """
    if normal.shape[1] == 2:
        edge = np.stack([-normal[:, 1], normal[:, 0]], axis=1)
    else:
        a, b = np.triu_indices(len(normal), 1)
        edge = np.cross(normal[a], normal[b])
    size = np.sqrt((edge**2).sum(axis=1))
    edge = edge[size > 1e-9] / size[size > 1e-9, None]
    along = np.vstack([edge, -edge]) @ normal.T
    return len(edge) > 0 and bool((along.max(axis=1) > 1e-9).all())


def held_contacts(contacts):
    """Return the contacts between particles that these hold one by one."""
    while True:
        end = np.concatenate([contacts.i_c, contacts.j_c])
        outward = np.concatenate([contacts.normal_cd, -contacts.normal_cd])
        held = np.array([is_held(outward[end == k]) for k in range(contacts.particles)])
        inside = held[contacts.i_c] & held[contacts.j_c]
        if inside.all():
            return contacts
        contacts = contacts.select(inside)


def null_space(rows):
    """Return orthonormal columns that span the motions which change no row."""
    value, vector = np.linalg.eigh((rows.T @ rows).toarray())
    return vector[:, value < RANK * value[-1]]


class Oracle:
    """A packing, and contacts of it that count."""

    def __init__(self, packing, contacts):
        self.packing, self.contacts, self.d = packing, contacts, packing.dimension

    def rows(self, contacts, strain):
        return rows_of(contacts.i_c, contacts.j_c, contacts.vector_cd, self.packing.particles, strain)

    def link_rows(self, strain):
        packing, links = self.packing, self.packing.links
        vector = links.vectors(packing.position_nd, packing.box.lattice_dd)
        return rows_of(links.i_l, links.j_l, vector, packing.particles, strain)

    def growth(self, strain):
        """Return the row of minus the volume: it may only grow; without strain there is none."""
        columns = self.packing.particles * self.d
        if not strain:
            return sp.csr_array((0, columns))
        axes = [(a, b) for a in range(self.d) for b in range(a, self.d)]
        return sp.csr_array(np.concatenate([np.zeros(columns), [-float(a == b) for a, b in axes]])[None, :])

    def groups(self, rows):
        """Return, for each particle, the group that it belongs to in all motions that change none of the rows."""
        motion = null_space(rows)[: self.packing.particles * self.d]
        blocks = motion @ np.random.default_rng(0).standard_normal((motion.shape[1], 2))
        blocks = blocks.reshape(self.packing.particles, -1)
        group = np.zeros(len(blocks), dtype=int)
        for column in blocks.T:
            order = np.argsort(column)
            step = np.concatenate([[0], np.cumsum(np.diff(column[order]) > 1e-5 * np.abs(blocks).max())])
            part = np.empty_like(group)
            part[order] = step
            _, group = np.unique(group * (len(blocks) + 1) + part, return_inverse=True)
        return group

    def carrying(self, contacts, strain):
        """Return which contacts carry force in some balance, and the volume too; one particle is held."""
        rows, growth, held = self.rows(contacts, strain), self.growth(strain), self.link_rows(strain)
        d = self.d
        return open_most(rows[:, d:], growth[:, d:], held[:, d:])

    def backbone(self):
        """Return the contacts of the collectively jammed backbone and its particles, or None if there is none."""
        contacts = self.contacts
        while len(contacts):
            if not self.packing.links:
                contacts = held_contacts(contacts)
            if not len(contacts):
                return None
            chosen = contacts.select(self.carrying(contacts, strain=False))
            if not len(chosen):
                return None
            group = self.groups(sp.vstack([self.rows(chosen, False), self.link_rows(False)]))
            inside = group == np.bincount(group).argmax()
            kept = chosen.select(inside[chosen.i_c] & inside[chosen.j_c])
            if len(kept) == len(chosen):
                # contacts of the group that carry nothing belong to its network too
                return contacts.select(inside[contacts.i_c] & inside[contacts.j_c]), inside
            contacts = kept
        return None

    def answers(self):
        """Return whether it is collectively and strictly jammed."""
        found = self.backbone()
        if found is None:
            return "not jammed", "not jammed"
        contacts, inside = found
        strictly = bool(self.carrying(contacts, strain=True).all())
        if strictly:
            rows = sp.vstack([self.rows(contacts, True), self.growth(True), self.link_rows(True)])
            strain = null_space(rows)[self.packing.particles * self.d :]
            group = self.groups(rows)
            strictly = np.abs(strain).max(initial=0.0) < 1e-5 and len(set(group[inside])) == 1
        return "jammed", "jammed" if strictly else "not jammed"


def answers(packing, contacts):
    """Return whether the contacts jam the packing, collectively and strictly, as HiGHS' simplex has it."""
    return Oracle(packing, contacts).answers()
