"""The Failure Recovery Protocol, explored: every state that a coordinator, its participants and the medium can reach.

After Ravn, Srba, Vighio and Marques, who did this for WS-BusinessActivity (TACAS 2011; STTT 2012, doi 10.1007/s10009-012-0231-4).

**What runs here is what runs.** A side is a `CoordinatorSession` or a `ParticipantSession`, given messages and made to speak, by the
tables of `somrs.protocol.frp.states`. Around them the model adds what the sessions leave to others, and no more:
- the medium, and nodes that repeat what is not acknowledged (`media.py`);
- the Task Manager's rules for a transaction: who may be accepted, when it stops and ends, who has to undo (`coordinator.py`);
- the Service Manager's: what its device does, its timers, what it reports after a restart (`participant.py`).

**What is left out**, because no state depends on it: bodies, but for whether an order is too late; the numbers of message ids, but for
telling messages of one type apart, and an order that is told anew has that of the first; how long anything takes: a timer may ring at any
time. A step of either side is one with its record in the journal, so a kill falls between two steps. It loses nothing that was recorded;
what was to be sent is sent after the restart, perhaps for the second time; what came and was not recorded was not acknowledged, and comes
again. Messages that can have no effect any more are dropped (`futures.py`).

**The one assumption about time**, `cut_off` of `system.Model`: when a coordinator gives a participant up, that participant's device has
come to rest. No protocol can keep two from working on one step without it: no message can prove that somebody silent has stopped.
That no order still under way makes it move again is the participant's doing, which refuses what comes after its `begin_by`;
`clocks` is what remains of that to assume: by then its clock shows that, too.

**Two participants** are two copies of one part that meet only in the rules of their transaction. The part is explored with whatever
others may do to it, made small by bisimulation (`quotient.py`), and joined with itself (`pair.py`). What is found of one part beside any
others holds for any number of participants.

**The properties** are in `properties.py`; `explore.py` finds the states and what leads home from each; `chart.py` draws how a property
falls; `mutations.py` alters the tables and sees whether anything is noticed.
"""
