; Two parcels have to change sides, so the vans have to meet at the market.
(define (problem change-sides) (:domain parcels)
  (:objects market mill harbour - place letter crate - parcel
    (:private van1 van1 - van)
    (:private van2 van2 - van))
  (:init
    (at van1 mill) (lies letter mill) (street van1 mill market) (street van1 market mill)
    (at van2 harbour) (lies crate harbour) (street van2 harbour market) (street van2 market harbour)
    (= (total-cost) 0) (= (km mill market) 4) (= (km market mill) 4) (= (km harbour market) 3) (= (km market harbour) 3))
  (:goal (and (lies letter harbour) (lies crate mill)))
  (:metric minimize (total-cost)))
