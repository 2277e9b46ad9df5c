"""Geometry of pairs: candidates, contacts and rattlers."""

from __future__ import annotations

from packmech.contacts.neighbors import Candidates, candidate_pairs
from packmech.contacts.network import Contacts, find_contacts, pair_contacts

__all__ = ["Candidates", "Contacts", "candidate_pairs", "find_contacts", "pair_contacts"]
