"""A small PDDL domain with two agents for tests: vans that meet at a depot."""

DOMAIN = """
(define (domain courier)
  (:requirements :typing :multi-agent :unfactored-privacy)
  (:types place locatable - object  van parcel - locatable)
  (:predicates (at ?x - locatable ?p - place) (road ?a ?b - place) (:private ?v - van (in ?b - parcel ?v - van)))
  (:action drive :agent ?v - van :parameters (?from ?to - place)
    :precondition (and (at ?v ?from) (road ?from ?to)) :effect (and (at ?v ?to) (not (at ?v ?from))))
  (:action load :agent ?v - van :parameters (?b - parcel ?p - place)
    :precondition (and (at ?v ?p) (at ?b ?p)) :effect (and (in ?b ?v) (not (at ?b ?p))))
  (:action unload :agent ?v - van :parameters (?b - parcel ?p - place)
    :precondition (and (at ?v ?p) (in ?b ?v)) :effect (and (at ?b ?p) (not (in ?b ?v)))))
"""
"""Two towns, a van in each, and a depot where parcels change vans."""

PROBLEM = """
(define (problem two-towns) (:domain courier)
  (:objects east west depot - place  red blue - parcel (:private van1 van1 - van) (:private van2 van2 - van))
  (:init (at van1 east) (at van2 west) (road east depot) (road depot east) (road west depot) (road depot west)
    (at red east) (at blue west))
  (:goal (and (at red west) (at blue east))))
"""
