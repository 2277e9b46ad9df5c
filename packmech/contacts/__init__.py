"""Geometry of pairs: candidates and contacts."""

from __future__ import annotations

from packmech.contacts.crossing import Crossings, crossing_links
from packmech.contacts.network import Candidates, Contacts, candidate_pairs, find_contacts, pair_contacts

__all__ = [
    "Candidates",
    "Contacts",
    "Crossings",
    "candidate_pairs",
    "crossing_links",
    "find_contacts",
    "pair_contacts",
]
