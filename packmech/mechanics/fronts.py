# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Multifrontal L D L^T of particles and rigid links, compiled.

Each node of a dissection gathers what is left of its children in a dense matrix (its front), adds its own particles and
links, and eliminates what it can. A link's row enters where the first of its particles is eliminated, and goes with one
of that particle's coordinates (`paired_links`). Where several links leave too little of one, it goes after the node's
particles if they hold it firmly enough; otherwise it waits for the parent.
"""

from __future__ import annotations

import numpy as np

from packmech.compiled import device, kernel
from packmech.mechanics.dense_fronts import LARGE, eliminate, finish, firm_links, reorder, work_size
from packmech.mechanics.paired_links import reduce_links, take_paired

# a link leaves where its pivot is at least this part of the unit of stiffness: growth stays below its inverse
_FIRM = 1e-2
_GOOD = 1e-1
# a pivot below this part of its row's own stiffness has lost its digits
_LOST = 1e-13


@device
def _grown(array, used, need):
    """Return the array, or a longer copy of it where it has no room for `need` more."""
    if used + need <= array.shape[0]:
        return array
    longer = np.empty(max(used + need, 3 * array.shape[0] // 2), array.dtype)
    longer[:used] = array[:used]
    return longer


@device
def _add_block(front, n, row, column, block, factor):
    """Add a block where the places of its rows and columns say, the upper triangle only."""
    d = block.shape[0]
    same = row[0] == column[0]
    for a in range(d):
        for b in range(a if same else 0, d):
            front[min(row[a], column[b]) * n + max(row[a], column[b])] += factor * block[a, b]


@kernel
def factor_fronts(tree, graph, pair_pdd, diagonal_ndd, link_i, link_j, link_graph, normal_ld, unit, pinned, space):
    """Return (failed, negative pivots, fronts, space): the factored system.

    Unknowns are N d displacements, then L link forces; the rows of the links are `unit` times the gradients, and unit
    n n stands in the particles' blocks too. `fronts` is (variables, first variable of each node, rows of U, first entry
    of each node, pivots of each node, pairs). The first pivots of a node are the coordinates that follow the others by
    its pairs: (first pair of each node, link of each pair, first entry of each pair in T, places, values, and the same
    of its shares in the node's links). `space` is working space, grown where need be: numbers of rows, waiting numbers,
    front, panels of it; the factored system stands in it.
    """
    member, node_start, children = tree
    start, neighbor, edge = graph
    link_start, link_entry = link_graph
    n_particles, d = diagonal_ndd.shape[0], diagonal_ndd.shape[1]
    n_links = normal_ld.shape[0]
    nodes = children.shape[0]
    place = np.full(n_particles, -1, np.int64)  # in the present front, -1 for who has none
    spot = np.empty((n_particles, d), np.int64)  # of each coordinate
    gone = np.zeros(n_particles, np.bool_)
    link_place = np.full(n_links, -1, np.int64)
    awake = np.zeros(n_links, np.bool_)
    firmness = np.zeros(n_particles)  # largest diagonal entry of each particle's own block
    variables = np.empty(4 * (n_particles * d + n_links) + 64, np.int64)
    variable_start = np.zeros(nodes + 1, np.int64)
    rows, waiting, front, work = space
    usual = (90 if d == 2 else 360) * (n_particles * d + n_links)
    if rows.shape[0] < usual:
        rows = np.empty(usual)
    row_start = np.zeros(nodes + 1, np.int64)
    pivots = np.zeros(nodes, np.int64)
    # what is left of finished nodes: particles, links and numbers, on three stacks
    waiting_n = np.empty(1024, np.int64)
    waiting_l = np.empty(256, np.int64)
    sizes = np.empty((nodes + 1, 2), np.int64)
    height = 0
    top_n = top_l = top = 0
    panel = np.empty((4, 256))
    pair_start = np.zeros(nodes + 1, np.int64)
    pair_link = np.empty(n_links, np.int64)
    tie_start, share_start = np.zeros(n_links + 1, np.int64), np.zeros(n_links + 1, np.int64)
    tie_at, tie = np.empty(8 * n_links + 64, np.int64), np.empty(8 * n_links + 64)
    share_at, share = np.empty(4 * n_links + 64, np.int64), np.empty(4 * n_links + 64)
    pairs = 0
    lines, shares = np.empty(4096), np.empty(256)
    taken = np.empty(n_particles * d, np.bool_)
    column = np.empty(n_links + 1, np.int64)
    own_v = np.empty(n_particles * d, np.int64)
    own_n = np.empty(n_particles, np.int64)
    own_l = np.empty(n_links, np.int64)
    order = np.empty(n_links + 1, np.int64)
    block = np.empty((d, d))
    negative = 0
    failed = False
    ranks = np.empty(n_particles, np.int64)
    rank = np.empty(n_particles, np.int64)
    for m in range(member.shape[0]):
        rank[member[m]] = m
    slot = np.empty(256, np.int64)
    for t in range(nodes):
        # who takes part: own particles, links, then the rim
        used_n = used_l = 0
        for m in range(node_start[t], node_start[t + 1]):
            own_n[used_n] = member[m]
            place[member[m]] = used_n * d
            used_n += 1
        inside = used_n
        base_n, base_l = top_n, top_l
        for c in range(children[t]):
            base_n -= sizes[height - 1 - c, 0]
            base_l -= sizes[height - 1 - c, 1]
        for h in range(base_l, top_l):
            own_l[used_l] = waiting_l[h]
            used_l += 1
        old_l = used_l
        for m in range(inside):
            i = own_n[m]
            for h in range(link_start[i], link_start[i + 1]):
                link = link_entry[h]
                if not awake[link]:
                    awake[link] = True
                    own_l[used_l] = link
                    used_l += 1
        for h in range(base_n, top_n):
            i = waiting_n[h]
            if place[i] < 0:
                place[i] = 0
                own_n[used_n] = i
                used_n += 1
        for m in range(inside):
            i = own_n[m]
            for h in range(start[i], start[i + 1]):
                j = neighbor[h]
                if place[j] < 0 and not gone[j] and j != pinned:
                    place[j] = 0
                    own_n[used_n] = j
                    used_n += 1
        # the rim in the order of its elimination: then the places of a child's rim rise, here too
        for m in range(inside, used_n):
            ranks[m] = rank[own_n[m]]
        ranks[inside:used_n].sort()
        for m in range(inside, used_n):
            own_n[m] = member[ranks[m]]
            place[own_n[m]] = m * d
        # links that wake up here, each with a coordinate that follows the others
        own = inside * d
        fresh, width = used_l - old_l, used_n * d
        if fresh * width > lines.shape[0]:
            lines = np.empty(2 * fresh * width)
        if fresh * fresh > shares.shape[0]:
            shares = np.empty(2 * fresh * fresh)
        line = lines[: fresh * width].reshape((fresh, width))
        part = shares[: fresh * fresh].reshape((fresh, fresh))
        for h in range(fresh):
            link = own_l[old_l + h]
            for k in range(width):
                line[h, k] = 0.0
            for end in range(2):
                i = link_i[link] if end == 0 else link_j[link]
                for a in range(d if i != pinned else 0):
                    line[h, place[i] + a] += (-unit if end == 0 else unit) * normal_ld[link, a]
        solved = reduce_links(line, part, fresh, width, own, unit, taken, column)
        first_pair = pairs
        used_l = old_l
        for h in range(fresh):
            link = own_l[old_l + h]
            if column[h] < 0:
                own_l[used_l] = link
                used_l += 1
            else:
                k = pairs - first_pair
                own_v[k] = own_n[column[h] // d] * d + column[h] % d
                spot[own_n[column[h] // d], column[h] % d] = k
                order[h] = pairs
                pair_link[pairs] = link
                pairs += 1
        pair_start[t + 1] = pairs
        at = solved
        for k in range(own):
            if not taken[k]:
                own_v[at] = own_n[k // d] * d + k % d
                spot[own_n[k // d], k % d] = at
                at += 1
        for h in range(used_l):
            link_place[own_l[h]] = own + h
        for m in range(inside, used_n):
            place[own_n[m]] = m * d + used_l
            for a in range(d):
                spot[own_n[m], a] = m * d + used_l + a
        for h in range(fresh):
            if column[h] >= 0:
                pair = order[h]
                tie_at, tie = _grown(tie_at, tie_start[pair], width), _grown(tie, tie_start[pair], width)
                at = tie_start[pair]
                for k in range(width):
                    if line[h, k] != 0.0 and not (k < own and taken[k]):
                        tie_at[at] = spot[own_n[k // d], k % d]
                        tie[at] = line[h, k]
                        at += 1
                tie_start[pair + 1] = at
                share_at, share = _grown(share_at, share_start[pair], fresh), _grown(share, share_start[pair], fresh)
                at = share_start[pair]
                for k in range(fresh):
                    if part[h, k] != 0.0:
                        share_at[at] = order[k] - first_pair
                        share[at] = part[h, k]
                        at += 1
                share_start[pair + 1] = at
        n = used_n * d + used_l
        if n * n > front.shape[0]:
            front = np.empty(max(n * n, 2 * front.shape[0]))
        if n > panel.shape[1]:
            panel = np.empty((4, 2 * n))
        if n >= LARGE and work_size(n) > work.shape[0]:
            work = np.empty(work_size(n) * 5 // 4)
        for k in range(n):
            for j in range(k * n + k, k * n + n):
                front[j] = 0.0
        # numbers: own particles and their pairs, links that wake up, then the children
        for m in range(inside):
            i = own_n[m]
            _add_block(front, n, spot[i], spot[i], diagonal_ndd[i], 1.0)
            for h in range(start[i], start[i + 1]):
                p = edge[h]
                if p < pair_pdd.shape[0]:
                    j = neighbor[h]
                    if place[j] > place[i]:
                        _add_block(front, n, spot[i], spot[j], pair_pdd[p], -1.0)
        for h in range(old_l, old_l + fresh):
            link = pair_link[first_pair + h - old_l] if h < old_l + solved else own_l[h - solved]
            i, j = link_i[link], link_j[link]
            for a in range(d):
                for b in range(d):
                    block[a, b] = normal_ld[link, a] * normal_ld[link, b]
            for end in range(2):
                i = link_i[link] if end == 0 else link_j[link]
                if i == pinned:
                    continue
                _add_block(front, n, spot[i], spot[i], block, unit)
                if h >= old_l + solved:
                    at = link_place[link]
                    for a in range(d):
                        value = (-unit if end == 0 else unit) * normal_ld[link, a]
                        front[min(at, spot[i, a]) * n + max(at, spot[i, a])] += value
            i = link_i[link]
            if i != pinned and j != pinned:
                _add_block(front, n, spot[i], spot[j], block, -unit)
        for m in range(inside):
            i = own_n[m]
            most = 0.0
            for a in range(d):
                size = abs(diagonal_ndd[i, a, a])
                most = max(most, size)
            firmness[i] = most + (unit if link_start[i + 1] > link_start[i] else 0.0)
        for _ in range(children[t]):
            height -= 1
            left_n, left_l = sizes[height, 0], sizes[height, 1]
            left = left_n * d + left_l
            top_n -= left_n
            top_l -= left_l
            top -= left * left
            if left > slot.shape[0]:
                slot = np.empty(2 * left, np.int64)
            for a in range(left_l):
                slot[a] = link_place[waiting_l[top_l + a]]
            mixed = left_l
            for m in range(left_n):
                i = waiting_n[top_n + m]
                for a in range(d):
                    slot[left_l + m * d + a] = spot[i, a]
                if place[i] < own:
                    mixed += d
            for a in range(mixed):
                line_a = top + a * left
                for b in range(a, left):
                    front[min(slot[a], slot[b]) * n + max(slot[a], slot[b])] += waiting[line_a + b]
            for a in range(mixed, left):
                row = slot[a] * n
                line_a = top + a * left
                for b in range(a, left):
                    front[row + slot[b]] += waiting[line_a + b]
        # elimination: particles, then the links that these hold
        stop = own + used_l
        for k in range(solved):
            pair = first_pair + k
            take_paired(front, n, k, tie_at, tie, tie_start[pair], tie_start[pair + 1], panel[0])
        negative += solved
        eliminate(front, n, solved, own, stop, panel, work)
        for k in range(solved, own):
            pivot = front[k * n + k]
            if not abs(pivot) > _LOST * firmness[own_v[k] // d]:
                failed = True
            negative += pivot < 0.0
        if failed:
            break
        done = 0
        if used_l > 0:
            root = t == nodes - 1
            done = firm_links(front, n, own, used_l, unit * (_LOST if root else _FIRM), unit * _GOOD, order)
            if root and done < used_l:
                failed = True
                break
            same = True
            for h in range(used_l):
                same = same and order[h] == h
            if not same:
                reorder(front, n, own, used_l, order)
                for h in range(used_l):
                    order[h] = own_l[order[h]]
                for h in range(used_l):
                    own_l[h] = order[h]
            eliminate(front, n, own, own + done, stop, panel, work)
            for k in range(own, own + done):
                negative += front[k * n + k] < 0.0
        pivot_count = own + done
        finish(front, n, solved, pivot_count, stop, panel, work)
        pivots[t] = pivot_count
        # keep the rows
        variables = _grown(variables, variable_start[t], n)
        at = variable_start[t]
        for k in range(own):
            variables[at] = own_v[k]
            at += 1
        for h in range(used_l):
            variables[at] = n_particles * d + own_l[h]
            at += 1
        for m in range(inside, used_n):
            for a in range(d):
                variables[at] = own_n[m] * d + a
                at += 1
        variable_start[t + 1] = at
        rows = _grown(rows, row_start[t], pivot_count * n)
        for k in range(pivot_count):
            for j in range(k * n + k, k * n + n):
                rows[row_start[t] + j] = front[j]
        row_start[t + 1] = row_start[t] + pivot_count * n
        # leave the rest to the parent
        left = n - pivot_count
        waiting_n = _grown(waiting_n, top_n, used_n - inside)
        waiting_l = _grown(waiting_l, top_l, used_l - done)
        waiting = _grown(waiting, top, left * left)
        for m in range(inside, used_n):
            waiting_n[top_n] = own_n[m]
            top_n += 1
        for h in range(done, used_l):
            waiting_l[top_l] = own_l[h]
            top_l += 1
        for a in range(left):
            for b in range(a, left):
                waiting[top + a * left + b] = front[(pivot_count + a) * n + pivot_count + b]
        top += left * left
        sizes[height, 0], sizes[height, 1] = used_n - inside, used_l - done
        height += 1
        for m in range(used_n):
            place[own_n[m]] = -1
        for m in range(inside):
            gone[own_n[m]] = True
    pair_tables = (pair_start, pair_link, tie_start, tie_at, tie, share_start, share_at, share)
    fronts = (variables, variable_start, rows, row_start, pivots, pair_tables)
    return failed, negative, fronts, (rows, waiting, front, work)
