"""A small PDDL domain that uses every supported feature: boats and cranes move boxes between quays."""

from __future__ import annotations

from pathlib import Path

DOMAIN = """
; Boats and cranes are agents; a boat is somewhere, as a box is.
(define (domain Harbour)
  (:requirements :typing :equality :negative-preconditions :action-costs :multi-agent :unfactored-privacy)
  (:types quay locatable crane - object
          boat box - locatable
          crate barrel - box)
  (:constants North - quay)
  (:predicates (at ?x - locatable ?q - quay) (in ?b - box ?boat - boat) (way ?a ?b - quay) (storm) (marked ?x - locatable)
    (:private ?c - crane (reaches ?c - crane ?q - quay) (holds ?c - crane ?b - box) (idle ?c - crane)))
  (:functions (total-cost) - number (miles ?a ?b - quay) - number (fee ?q - quay) - number (bell) - number
    (fuel ?b - boat) - number)

  (:action Sail
    :agent ?b - boat
    :parameters (?from ?to - quay)
    :precondition (and (at ?b ?from) (or (way ?from ?to) (way ?to ?from)) (not (storm)) (>= (- (fuel ?b) 1) (* (miles ?from ?to) 0.5)))
    :effect (and (at ?b ?to) (not (at ?b ?from)) (increase (total-cost) (+ (miles ?from ?to) (* 2 (bell))))
      (decrease (fuel ?b) (/ (miles ?from ?to) 2))))
  (:action pump
    :agent ?b - boat
    :parameters (?other - boat)
    :precondition (>= (fuel ?b) 3)
    :effect (and (decrease (fuel ?b) 3) (increase (fuel ?other) 2) (increase (total-cost) 1) (increase (total-cost) 2)))
  (:action refill
    :agent ?b - boat
    :parameters ()
    :effect (and (assign (fuel ?b) (+ 10 (* (bell) 3))) (assign (bell) 6) (increase (total-cost) 5)))
  (:action lift
    :agent ?c - crane
    :parameters (?b - box ?q - quay)
    :precondition (and (reaches ?c ?q) (at ?b ?q) (idle ?c))
    :effect (and (holds ?c ?b) (not (at ?b ?q)) (not (idle ?c)) (increase (total-cost) (fee ?q))))
  (:action stow
    :agent ?c - crane
    :parameters (?b - box ?boat - boat ?q - quay)
    :precondition (and (holds ?c ?b) (reaches ?c ?q) (at ?boat ?q))
    :effect (and (in ?b ?boat) (idle ?c) (not (holds ?c ?b)) (increase (total-cost) 1)))
  (:action unload
    :agent ?c - crane
    :parameters (?b - box ?boat - boat ?q - quay)
    :precondition (and (in ?b ?boat) (reaches ?c ?q) (at ?boat ?q))
    :effect (and (at ?b ?q) (not (in ?b ?boat)) (increase (total-cost) (fee ?q))))
  (:action signal
    :agent ?a - (either crane boat)
    :parameters (?x - locatable)
    :precondition (and (not (marked ?x)) (>= (bell) 1))
    :effect (and (marked ?x) (increase (total-cost) (bell))))
  (:action hand-over
    :agent ?c - crane
    :parameters (?d - crane ?b ?other - box)
    :precondition (and (holds ?c ?b) (idle ?d) (not (= ?c ?d)) (imply (marked ?other) (= ?b ?other)))
    :effect (and (not (holds ?c ?b)) (holds ?d ?b) (idle ?c) (not (idle ?d)) (not (marked ?b)) (marked ?other))))
"""

PROBLEM = """
(define (problem two-quays) (:domain harbour)
  (:objects South - quay crate1 - crate barrel1 - barrel
    (:private boat1 boat1 - boat) (:private boat2 boat2 - boat) (:private crane1 crane1 - crane) (:private crane2 crane2 - crane))
  (:init (= (total-cost) 0) (at boat1 north) (at crate1 north) (at barrel1 south) (way north south) (reaches crane1 north) (idle crane1)
    (reaches crane2 south) (idle crane2) (= (miles north south) 12) (= (miles south north) 7.5) (= (fee north) 2) (= (fee south) 3)
    (= (bell) 4) (at boat2 south) (= (fuel boat1) 7.5) (= (fuel boat2) 20))
  (:goal (and (at crate1 south) (not (at barrel1 south)) (marked boat1)))
  (:metric minimize (total-cost)))
"""


def written(folder: Path, domain: str = DOMAIN, problem: str = PROBLEM) -> tuple[Path, Path]:
    """Write both files to the folder, and return their paths."""
    files = folder / "domain.pddl", folder / "problem.pddl"
    for file, text in zip(files, (domain, problem), strict=True):
        file.write_text(text, encoding="utf-8")
    return files
