// A client of another make: client NAME TASK_MANAGER WRONG_EFFECT EFFECT [KEY AUTHORITY]
//
// It submits a task that is rejected, and one whose outcome it awaits. It writes the problem of the first and the outcome of the second as
// lines of text.

#include "RegistryBinding.nsmap"
#include "connection.h"
#include "soapTaskManagerBindingProxy.h"

const std::string ACTIONS = "urn:so-mrs:clients:1.0:";

/// The identifier of the new task; empty if it is rejected.
std::string submit(TaskManagerBindingProxy &manager, const std::string &recipient, const std::string &effect) {
  address(manager.soap, recipient, ACTIONS + "Submit");
  clients__Submitted submitted;
  if (manager.Submit(soap_new_req_clients__Submit(manager.soap, effect), submitted) == SOAP_OK) return submitted.Task;
  const SOAP_ENV__Detail *detail = manager.soap->fault ? manager.soap->fault->SOAP_ENV__Detail : nullptr;
  if (!detail || !detail->clients__TaskRejected_) fail(manager.soap);
  std::printf("%s\n", detail->clients__TaskRejected_->Problem.c_str());
  return "";
}

/// Wait until a task has ended. How it has ended.
std::string outcome(TaskManagerBindingProxy &manager, const std::string &recipient, const std::string &task) {
  LONG64 after = 0;
  while (true) {
    address(manager.soap, recipient, ACTIONS + "WatchTask");
    clients__WatchTask *request = soap_new_req_clients__WatchTask(manager.soap, task);
    double wait = 5;
    request->After = &after;
    request->Wait = &wait;
    clients__TaskNews news;
    if (manager.WatchTask(request, news)) fail(manager.soap);
    if (news.View && news.View->Outcome) return soap_clients__Outcome2s(manager.soap, *news.View->Outcome);
    if (!news.Events.empty()) after = news.Events.back()->Number;
    manager.destroy();
  }
}

int main(int count, char **arguments) {
  if (count != 5 && count != 7) return 2;
  const std::string recipient = arguments[2];
  const Identity identity{arguments[1], count == 7 ? arguments[5] : "", count == 7 ? arguments[6] : ""};
  TaskManagerBindingProxy manager(recipient.c_str());
  prepare_client(manager.soap, identity);
  if (!submit(manager, recipient, arguments[3]).empty()) return 3;
  const std::string task = submit(manager, recipient, arguments[4]);
  std::printf("%s\n", outcome(manager, recipient, task).c_str());
  manager.destroy();
}
