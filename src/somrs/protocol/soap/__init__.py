"""Encode messages as SOAP 1.2 envelopes and decode them; their XML Schema and WSDL."""
