"""Geometry of pairs: candidates, contacts and rattlers."""

from __future__ import annotations

from packmech.contacts.crossing import Crossings, crossing_links
from packmech.contacts.neighbors import Candidates, candidate_pairs
from packmech.contacts.network import Contacts, find_contacts, pair_contacts
from packmech.contacts.rattlers import find_rattlers, remove_rattlers

__all__ = [
    "Candidates",
    "Contacts",
    "Crossings",
    "candidate_pairs",
    "crossing_links",
    "find_contacts",
    "find_rattlers",
    "pair_contacts",
    "remove_rattlers",
]
