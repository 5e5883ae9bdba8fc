// What the programs have in common: how they prove who they are, and the WS-Addressing headers of their messages.

#pragma once

#include <cstdio>
#include <cstdlib>
#include <csignal>
#include <string>

#include "soapH.h"
#include "wsaapi.h"

/// Seconds for a peer that does not answer. Answers to WatchTask come after several.
constexpr int PATIENCE = 60;

/// How a program proves who it is. `key`: a PEM file with its key and its certificate; empty if the system has no certificates.
struct Identity {
  std::string name, key, authority;

  bool has_certificate() const { return !key.empty(); }
};

[[noreturn]] inline void fail(soap *context) {
  soap_print_fault(context, stderr);
  std::exit(1);
}

/// Prepare a context for messages that this program sends.
inline void prepare_client(soap *context, const Identity &identity) {
  soap_register_plugin(context, soap_wsa);
  context->connect_timeout = context->send_timeout = context->recv_timeout = PATIENCE;
  if (identity.has_certificate() &&
      soap_ssl_client_context(context, SOAP_SSL_DEFAULT, identity.key.c_str(), nullptr, identity.authority.c_str(), nullptr, nullptr))
    fail(context);
}

/// Prepare a context for messages that come: whoever connects has to show a certificate of the same authority.
inline void prepare_server(soap *context, const Identity &identity) {
  soap_register_plugin(context, soap_wsa);
  context->bind_flags = SO_REUSEADDR;
  context->send_timeout = context->recv_timeout = PATIENCE;
  if (identity.has_certificate() &&
      soap_ssl_server_context(context, SOAP_SSL_REQUIRE_CLIENT_AUTHENTICATION, identity.key.c_str(), nullptr, identity.authority.c_str(),
                              nullptr, nullptr, nullptr, identity.name.c_str()))
    fail(context);
}

/// Set the headers of the next message. `own`: where this program listens; empty if it does not.
inline void address(soap *context, const std::string &recipient, const std::string &action, const std::string &own = "",
                    const std::string &relates_to = "") {
  soap_wsa_request(context, soap_wsa_rand_uuid(context), soap_strdup(context, recipient.c_str()), soap_strdup(context, action.c_str()));
  if (!own.empty()) soap_wsa_add_From(context, soap_strdup(context, own.c_str()));
  if (!relates_to.empty()) soap_wsa_add_RelatesTo(context, soap_strdup(context, relates_to.c_str()));
}
