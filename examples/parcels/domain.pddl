; Vans carry parcels. Each van knows only its own streets.
(define (domain parcels)
  (:requirements :typing :action-costs :multi-agent :unfactored-privacy)
  (:types place parcel van - object)
  (:predicates
    (at ?v - van ?p - place)
    (lies ?x - parcel ?p - place)
    (in ?x - parcel ?v - van)
    (:private ?v - van (street ?v - van ?from ?to - place)))
  (:functions (total-cost) - number (km ?from ?to - place) - number)

  (:action drive
    :agent ?v - van
    :parameters (?from ?to - place)
    :precondition (and (at ?v ?from) (street ?v ?from ?to))
    :effect (and (not (at ?v ?from)) (at ?v ?to) (increase (total-cost) (km ?from ?to))))

  (:action load
    :agent ?v - van
    :parameters (?x - parcel ?p - place)
    :precondition (and (at ?v ?p) (lies ?x ?p))
    :effect (and (not (lies ?x ?p)) (in ?x ?v) (increase (total-cost) 1)))

  (:action unload
    :agent ?v - van
    :parameters (?x - parcel ?p - place)
    :precondition (and (at ?v ?p) (in ?x ?v))
    :effect (and (lies ?x ?p) (not (in ?x ?v)) (increase (total-cost) 1))))
