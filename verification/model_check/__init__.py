"""A model check of the Failure Recovery Protocol: explores every state that a coordinator, its participants and the medium can reach.

The method is that of Ravn, Srba, Vighio and Marques, who checked WS-BusinessActivity (TACAS 2011; STTT 2012, doi
10.1007/s10009-012-0231-4).

**The model runs the product's code.** A side is a `CoordinatorSession` or a `ParticipantSession`, which receives and sends messages by the
tables of `somrs.protocol.frp.states`. The model adds only what the sessions leave to other modules:
- the medium, and nodes that repeat messages that are not acknowledged (`media.py`);
- the Task Manager's rules for a transaction: when a participant is accepted, stopped, released or compensated (`coordinator.py`);
- the Service Manager's rules: device, timers, and the report after a restart (`participant.py`).

**The model abstracts from details** that no state depends on. Bodies are constant; only the expiry of an order is modelled. Message ids
only distinguish messages of one type, and a repeated order keeps its id. There are no durations: a timer can fire at any time. A step of a
side and its record in the journal are atomic, so a kill falls between two steps and loses nothing that was recorded. After a restart, a
side sends what it had to send, possibly again; an input that was not recorded was not acknowledged, and arrives again. Messages that cannot
have an effect any more are dropped (`futures.py`).

**The timing assumption** is `cut_off` of `system.Model`: when a coordinator gives a participant up, the participant's device has stopped.
No protocol can ensure mutual exclusion without it, because no message can prove that a silent device has stopped. Orders in transit need no
such assumption: the participant refuses an order that arrives after its `begin_by`. `clocks` assumes that the participant's clock shows
this time as well when the coordinator gives it up.

**Two participants** are two copies of one part, which interact only by the rules of their transaction. The part is explored with every
possible behaviour of the others, reduced by bisimulation (`quotient.py`), and composed with itself (`pair.py`). A result for one part
beside arbitrary others holds for any number of participants.

`properties.py` defines the properties. `explore.py` finds the reachable states and checks termination. `chart.py` draws counterexamples.
`mutations.py` alters the tables and tests whether a property is violated.
"""
