"""Proofs by exhaustion: what must hold of the protocol, whatever happens, checked in every state that can be reached."""
