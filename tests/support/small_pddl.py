"""Small planning problems, each with a feature of published problems that is easily handled wrongly."""

from __future__ import annotations

import tempfile
from pathlib import Path

from somrs.planner.model.problem import Problem
from somrs.sites.pddl import read
from tests.support import courier

YARD = """
; Chests that stand on each other hang at a hoist while they change places: where one is, several kinds of facts say, some of them private.
(define (domain yard)
  (:requirements :typing :multi-agent :unfactored-privacy)
  (:types place movable driver - object  bay - place  lorry hoist stack - movable  base chest - stack)
  (:predicates (at ?x - movable ?p - place) (on ?c - chest ?s - stack) (in ?c - chest ?l - lorry) (free ?s - stack)
    (:private ?p - place (hangs ?p - place ?h - hoist ?c - chest) (ready ?p - place ?h - hoist))
    (:private ?d - driver (drives ?d - driver ?l - lorry)))
  (:action go :agent ?d - driver :parameters (?l - lorry ?from ?to - place)
    :precondition (and (drives ?d ?l) (at ?l ?from)) :effect (and (at ?l ?to) (not (at ?l ?from))))
  (:action raise :agent ?p - place :parameters (?h - hoist ?c - chest ?s - stack)
    :precondition (and (at ?h ?p) (ready ?p ?h) (at ?c ?p) (on ?c ?s) (free ?c))
    :effect (and (hangs ?p ?h ?c) (free ?s) (not (at ?c ?p)) (not (on ?c ?s)) (not (free ?c)) (not (ready ?p ?h))))
  (:action lower :agent ?p - place :parameters (?h - hoist ?c - chest ?s - stack)
    :precondition (and (at ?h ?p) (hangs ?p ?h ?c) (at ?s ?p) (free ?s))
    :effect (and (at ?c ?p) (on ?c ?s) (free ?c) (ready ?p ?h) (not (hangs ?p ?h ?c)) (not (free ?s))))
  (:action load :agent ?p - place :parameters (?h - hoist ?c - chest ?l - lorry)
    :precondition (and (at ?h ?p) (at ?l ?p) (hangs ?p ?h ?c)) :effect (and (in ?c ?l) (ready ?p ?h) (not (hangs ?p ?h ?c))))
  (:action unload :agent ?p - place :parameters (?h - hoist ?c - chest ?l - lorry)
    :precondition (and (at ?h ?p) (at ?l ?p) (ready ?p ?h) (in ?c ?l))
    :effect (and (hangs ?p ?h ?c) (not (in ?c ?l)) (not (ready ?p ?h)))))
"""

SWAP = """
(define (problem swap) (:domain yard)
  (:objects lorry1 - lorry hoist1 hoist2 - hoist base1 base2 - base chest1 chest2 - chest
    (:private north north - bay) (:private south south - bay) (:private ann ann - driver))
  (:init (at lorry1 south) (drives ann lorry1) (at hoist1 north) (ready north hoist1) (at hoist2 south) (ready south hoist2)
    (at base1 north) (at base2 south) (at chest1 north) (on chest1 base1) (free chest1) (at chest2 south) (on chest2 base2) (free chest2))
  (:goal (and (on chest1 base2) (on chest2 base1))))
"""

BEACONS = """
; What must not be so is said in facts of their own, as where negative conditions are not allowed; and each deed takes some of a charge.
(define (domain beacons)
  (:requirements :strips :typing :multi-agent :unfactored-privacy)
  (:types node charge note - object  beacon base - node)
  (:predicates (linked ?a ?b - node) (less ?a ?b - charge) (reading ?n - node ?b - beacon) (lies ?m - note ?n - node)
    (lies-not ?m - note ?n - node) (tells ?m - note ?b - beacon) (tells-not ?m - note ?b - beacon)
    (under-way ?from - beacon ?to - node ?m - note) (not-under-way ?from - beacon ?to - node ?m - note)
    (:private ?b - beacon (left ?b - beacon ?c - charge)))
  (:action measure :agent ?b - beacon :parameters (?c ?d - charge)
    :precondition (and (left ?b ?c) (less ?d ?c)) :effect (and (left ?b ?d) (not (left ?b ?c)) (reading ?b ?b)))
  (:action write :agent ?b - beacon :parameters (?of - beacon ?m - note)
    :precondition (and (reading ?b ?of) (lies ?m ?b) (tells-not ?m ?of))
    :effect (and (tells ?m ?of) (not (tells-not ?m ?of)) (not (reading ?b ?of))))
  (:action send :agent ?b - beacon :parameters (?to - node ?m - note ?c ?d - charge)
    :precondition (and (left ?b ?c) (less ?d ?c) (linked ?b ?to) (lies ?m ?b) (lies-not ?m ?to) (not-under-way ?b ?to ?m))
    :effect (and (left ?b ?d) (not (left ?b ?c)) (under-way ?b ?to ?m) (not (not-under-way ?b ?to ?m))
      (lies-not ?m ?b) (not (lies ?m ?b))))
  (:action take :agent ?n - node :parameters (?from - beacon ?m - note)
    :precondition (and (lies-not ?m ?n) (under-way ?from ?n ?m))
    :effect (and (lies ?m ?n) (not (lies-not ?m ?n)) (not-under-way ?from ?n ?m) (not (under-way ?from ?n ?m))))
  (:action look :agent ?n - node :parameters (?b - beacon ?m - note)
    :precondition (and (lies ?m ?n) (tells ?m ?b)) :effect (and (reading ?n ?b) (tells-not ?m ?b) (not (tells ?m ?b)))))
"""

COAST = """
(define (problem coast) (:domain beacons)
  (:objects none some full - charge note1 - note
    (:private east east - beacon) (:private west west - beacon) (:private tower tower - base))
  (:init (linked east west) (linked west east) (linked west tower) (less none some) (less some full) (left east full) (left west full)
    (lies note1 east) (lies-not note1 west) (lies-not note1 tower) (tells-not note1 east) (tells-not note1 west)
    (not-under-way east west note1) (not-under-way east tower note1) (not-under-way east east note1)
    (not-under-way west east note1) (not-under-way west tower note1) (not-under-way west west note1))
  (:goal (and (reading tower east) (reading tower west))))
"""

GARDEN = """
; Quantifiers, effects under conditions, a type below two others, and an object of one of two types.
(define (domain garden)
  (:requirements :adl :action-costs :multi-agent)
  (:types bed tool - object  bed - spot  planter - bed  planter - tool  spot gardener)
  (:predicates (dry ?b - bed) (sown ?b - bed) (beside ?a ?b - bed) (blocked ?b - bed) (held ?t - tool) (at ?t - tool ?s - spot) (sunny)
    (sheltered ?b - bed))
  (:functions (total-cost) (visits ?b - bed))
  (:action sow :agent ?g - gardener :parameters (?b - bed)
    :precondition (and (forall (?o - bed) (imply (beside ?b ?o) (not (dry ?o)))) (not (exists (?t - tool) (at ?t ?b)))
      (exists (?t - tool) (and (held ?t) (not (= ?t ?b)))))
    :effect (and (sown ?b) (increase (total-cost) 1) (when (sunny) (and (dry ?b) (assign (visits ?b) 1) (increase (total-cost) 2)))
      (when (and (sheltered ?b) (blocked ?b)) (not (blocked ?b)))))
  (:action rain :agent ?g - gardener :parameters ()
    :precondition (or (sunny) (forall (?b - bed) (dry ?b)))
    :effect (and (not (sunny)) (forall (?b - bed) (not (dry ?b))) (forall (?b - planter) (when (sown ?b) (blocked ?b)))))
  (:action shine :agent ?g - gardener :parameters () :effect (and (sunny) (forall (?b - bed) (when (sheltered ?b) (dry ?b)))))
  (:action flood :agent ?g - gardener :parameters (?b - bed)
    :effect (and (when (not (blocked ?b)) (blocked ?b)) (forall (?o - bed) (when (dry ?o) (not (dry ?o))))
      (forall (?o - bed) (when (sown ?o) (not (sown ?o))))))
  (:action fetch :agent ?g - gardener :parameters (?t - tool ?s - spot) :precondition (at ?t ?s) :effect (and (held ?t) (not (at ?t ?s))))
  (:action leave :agent ?g - gardener :parameters (?t - tool ?s - spot) :precondition (held ?t) :effect (and (at ?t ?s) (not (held ?t)))))
"""

SPRING = """
(define (problem spring) (:domain garden)
  (:objects rose tulip - bed pot - planter tub - (either bed tool) rake - tool path - spot ann - gardener)
  (:init (sunny) (dry rose) (dry tulip) (beside rose tulip) (beside tulip rose) (beside pot rose) (sheltered tulip) (sheltered pot)
    (blocked tulip) (at rake path) (at tub path) (held pot) (= (total-cost) 0) (= (visits rose) 0) (= (visits tulip) 0) (= (visits pot) 0)
    (= (visits tub) 0))
  (:goal (and (forall (?b - bed) (sown ?b)) (not (exists (?t - tool) (held ?t)))))
  (:metric minimize (total-cost)))
"""

AIRFIELD = """
; More effects under conditions than can be combined, but facts that never change decide about most of them.
(define (domain airfield)
  (:requirements :adl :action-costs :multi-agent)
  (:types plane stand size)
  (:constants small - size)
  (:predicates (is ?p - plane ?z - size) (joined ?a ?b - stand) (near ?z - size ?a ?b - stand) (at ?p - plane ?s - stand)
    (blocked ?s - stand ?p - plane) (watched ?s - stand) (open) (wet ?s - stand))
  (:functions (total-cost))
  (:action taxi :agent ?p - plane :parameters (?z - size ?a ?b - stand)
    :precondition (and (is ?p ?z) (at ?p ?a) (joined ?a ?b) (not (= ?a ?b))
      (forall (?o - plane) (imply (not (= ?o ?p)) (not (blocked ?b ?o)))))
    :effect (and (at ?p ?b) (not (at ?p ?a)) (increase (total-cost) 1)
      (forall (?s - stand) (when (and (near ?z ?a ?s) (not (near ?z ?b ?s))) (not (blocked ?s ?p))))
      (forall (?s - stand) (when (near ?z ?b ?s) (blocked ?s ?p)))
      (forall (?s - stand) (when (or (joined ?b ?s) (watched ?s)) (wet ?s)))
      (when (and (watched ?b) (open)) (and (not (open)) (increase (total-cost) 2)))
      (when (not (watched ?b)) (open))))
  (:action sprinkle :agent ?p - plane :parameters (?s - stand)
    :effect (and (wet ?s) (forall (?o - stand) (when (joined ?s ?o) (when (at ?p ?o) (wet ?o))))
      (forall (?o - stand) (when (near small ?o ?s) (not (wet ?o)))))))
"""

MORNING = """
(define (problem morning) (:domain airfield)
  (:objects s1 s2 s3 s4 - stand kite jumbo - plane large - size)
  (:init (is kite small) (is jumbo large) (joined s1 s2) (joined s2 s3) (joined s3 s4) (joined s4 s1) (joined s2 s1) (joined s3 s3)
    (near small s1 s1) (near small s2 s2) (near small s3 s3) (near small s4 s4)
    (near large s1 s1) (near large s2 s2) (near large s2 s1) (near large s3 s3) (near large s3 s2) (near large s4 s4)
    (at kite s1) (blocked s1 kite) (at jumbo s3) (blocked s3 jumbo) (blocked s2 jumbo) (watched s4) (open)
    (= (total-cost) 0))
  (:goal (and (at kite s3) (at jumbo s1) (wet s2)))
  (:metric minimize (total-cost)))
"""

PROBLEMS = {
    "yard": (YARD, SWAP),
    "beacons": (BEACONS, COAST),
    "courier": (courier.DOMAIN, courier.PROBLEM),
    "garden": (GARDEN, SPRING),
    "airfield": (AIRFIELD, MORNING),
}


def small(name: str) -> Problem:
    with tempfile.TemporaryDirectory() as folder:
        files = Path(folder) / "domain.pddl", Path(folder) / "problem.pddl"
        for file, text in zip(files, PROBLEMS[name], strict=True):
            file.write_text(text, encoding="utf-8")
        return read(*files).problem()
