// A robot of another make: participant NAME PORT REGISTRY [KEY AUTHORITY]
//
// It offers to carry things, and carries them in no time. It writes what the Registry has answered to its offer, and each message that comes,
// as lines of JSON.

#include <deque>
#include <functional>
#include <map>

#include "RegistryBinding.nsmap"
#include "connection.h"
#include "soapRegistryBindingProxy.h"
#include "soapServiceManagerBindingService.h"
#include "soapTaskManagerBindingProxy.h"

const std::string ACTIONS = "urn:so-mrs:frp:1.0:";

/// A contract: what is to be so afterwards, and how far it is.
struct Contract {
  std::string effect;
  frp__State state = frp__State__New;
};

/// Takes the messages of coordinators. What it answers is sent when the message has been acknowledged: `replies`.
class Robot : public ServiceManagerBindingService {
 public:
  std::deque<std::function<void()>> replies;

  Robot(const Identity &identity, const std::string &own) : identity_(identity), own_(own), coordinator_(SOAP_C_UTFSTRING) {
    prepare_server(soap, identity);
    soap_set_mode(soap, SOAP_C_UTFSTRING);
    prepare_client(coordinator_.soap, identity);
  }

  int Arrange(frp__Arrange *message) override {
    hear("Arrange", message, frp__State__Offered);
    contracts_[message->Participant].effect = message->Effect;
    const std::string precondition = message->Precondition ? *message->Precondition : "";
    const std::string effect = message->Effect;
    return reply(message, "Terms", [=](struct soap *context, const std::string &transaction, const std::string &participant) {
      frp__Terms *terms = soap_new_req_frp__Terms(context, transaction, participant, effect, 0.0, 1.0);
      if (!precondition.empty()) {
        terms->Precondition = soap_new_std__string(context);
        *terms->Precondition = precondition;
      }
      return coordinator_.Terms(terms);
    });
  }

  int Accept(frp__Accept *message) override { return note("Accept", message, frp__State__Committed); }

  int Execute(frp__Execute *message) override {
    hear("Execute", message, frp__State__Completed);
    const std::string situation = contracts_[message->Participant].effect;
    return reply(message, "Completed", [=](struct soap *context, const std::string &transaction, const std::string &participant) {
      return coordinator_.Completed(soap_new_req_frp__Completed(context, transaction, participant, situation));
    });
  }

  int Stop(frp__Stop *message) override {
    hear("Stop", message, frp__State__Stopped);
    return reply(message, "Stopped", [=](struct soap *context, const std::string &transaction, const std::string &participant) {
      return coordinator_.Stopped(soap_new_req_frp__Stopped(context, transaction, participant));
    });
  }

  int Query(frp__Query *message, frp__Status &status) override {
    status.Transaction = message->Transaction;
    status.Participant = message->Participant;
    status.State = contracts_[message->Participant].state;
    return soap_wsa_reply(soap, nullptr, (ACTIONS + "Status").c_str());
  }

  int Cancel(frp__Cancel *message) override { return note("Cancel", message, frp__State__Ended); }
  int Compensate(frp__Compensate *message) override { return note("Compensate", message, frp__State__Compensated); }
  int End(frp__End *message) override { return note("End", message, frp__State__Ended); }
  int ServiceTypesChanged(directory__ServiceTypesChanged *) override { return send_ServiceTypesChanged_empty_response(); }
  ServiceManagerBindingService *copy() override { return nullptr; }  // it serves one message at a time

 private:
  const Identity identity_;
  const std::string own_;
  TaskManagerBindingProxy coordinator_;
  std::map<std::string, Contract> contracts_;

  template <class Message>
  void hear(const char *name, const Message *message, frp__State state) {
    contracts_[message->Participant].state = state;
    std::printf("{\"name\": \"%s\", \"participant\": \"%s\"}\n", name, message->Participant.c_str());
    std::fflush(stdout);
  }

  /// Take a message that needs no answer, and acknowledge it.
  template <class Message>
  int note(const char *name, const Message *message, frp__State state) {
    hear(name, message, state);
    return soap_send_empty_response(soap, 202);
  }

  /// Acknowledge a message, and have the answer sent afterwards, to where it is to go.
  template <class Message, class Send>
  int reply(const Message *message, const std::string &name, Send send) {
    const char *coordinator = soap_wsa_ReplyTo(soap) ? soap_wsa_ReplyTo(soap) : soap_wsa_From(soap);
    if (!coordinator) return soap_wsa_sender_fault(soap, "a message of the Failure Recovery Protocol has a ReplyTo or a From", nullptr);
    const std::string recipient = coordinator, relates_to = soap->header->wsa5__MessageID;
    const std::string transaction = message->Transaction, participant = message->Participant;
    replies.push_back([=] {
      coordinator_.soap_endpoint = recipient.c_str();
      address(coordinator_.soap, recipient, ACTIONS + name, own_, relates_to);
      if (send(coordinator_.soap, transaction, participant)) coordinator_.soap_print_fault(stderr);
      coordinator_.destroy();
    });
    return soap_send_empty_response(soap, 202);
  }
};

/// Offer the service of carrying things.
void publish(const Identity &identity, const std::string &own, const std::string &recipient) {
  RegistryBindingProxy registry(recipient.c_str(), SOAP_C_UTFSTRING);
  struct soap *context = registry.soap;
  prepare_client(context, identity);
  directory__ServiceType *type = soap_new_req_directory__ServiceType(context, "TransferObject", "?Object isOn ?Destination");
  std::string precondition = "?Object isOn ?Source AND ?Destination.Supporting = TRUE";
  type->Precondition = &precondition;
  type->Inputs = {soap_new_req_directory__Parameter(context, "Object", "Graspable"),
                  soap_new_req_directory__Parameter(context, "Destination", "Object")};
  directory__Publish *offers = soap_new_req_directory__Publish(context, identity.name, 600.0);
  offers->Offers = {soap_new_req_directory__Offer(context, identity.name + ".TransferObject", identity.name, "PioneerP3DX", own, type)};
  directory__Published published;
  address(context, recipient, "urn:so-mrs:directory:1.0:Publish", own);
  if (registry.Publish(offers, published)) fail(context);
  std::printf("{\"published\": {%s}}\n", published.Withheld.empty() ? "" : "\"Withheld\": true");
  std::fflush(stdout);
  registry.destroy();
}

int main(int count, char **arguments) {
  if (count != 4 && count != 6) return 2;
  std::signal(SIGPIPE, SIG_IGN);  // a connection that ends is an error of its own
  const Identity identity{arguments[1], count == 6 ? arguments[4] : "", count == 6 ? arguments[5] : ""};
  const std::string scheme = identity.has_certificate() ? "https" : "http";
  const std::string own = scheme + "://127.0.0.1:" + arguments[2] + "/devices/" + identity.name;
  Robot robot(identity, own);
  if (!soap_valid_socket(robot.bind("127.0.0.1", std::atoi(arguments[2]), 100))) fail(robot.soap);
  publish(identity, own, arguments[3]);
  while (soap_valid_socket(robot.accept())) {
    if ((identity.has_certificate() && robot.ssl_accept()) || robot.serve()) robot.soap_print_fault(stderr);
    robot.destroy();
    for (; !robot.replies.empty(); robot.replies.pop_front()) robot.replies.front()();
  }
  fail(robot.soap);
}
