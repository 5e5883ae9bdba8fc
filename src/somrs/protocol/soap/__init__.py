"""Messages as SOAP 1.2 envelopes and back, with their XML Schema and WSDL."""
