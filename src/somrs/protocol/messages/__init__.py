"""All messages: the envelope (WS-Addressing) and the bodies, by protocol."""
