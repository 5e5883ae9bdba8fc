"""The closed set of message bodies, by protocol."""

from __future__ import annotations

from typing import TYPE_CHECKING

from somrs.protocol.messages import (
    directory,
    frp,
    knowledge,
    neighbours,
    orders,
    previews,
    records,
    reservations,
    submission,
    task_news,
    traffic,
)
from somrs.protocol.messages.body import MessageBody

FrpBody = (
    frp.Arrange | frp.Terms | frp.Refuse | frp.Accept | frp.Cancel | frp.Execute | frp.Progress | frp.Completed
    | frp.Failed | frp.Stop | frp.Stopped | frp.Compensate | frp.Compensated | frp.Stranded | frp.Query | frp.Status
    | frp.End | frp.Fault
)  # fmt: skip
DirectoryBody = (
    directory.Publish | directory.Published | directory.Renew | directory.Retract | directory.Retracted
    | directory.Discover | directory.Discovered | directory.SubscribeServices | directory.ServicesSubscribed
    | directory.ServicesJoined | directory.ServicesLeft | directory.ReadPresence | directory.PresenceLog
    | directory.ServiceTypesChanged
)  # fmt: skip
KnowledgeBody = (
    knowledge.ReadOntology | knowledge.OntologyPage | knowledge.Define | knowledge.Defined | knowledge.ReadMap
    | knowledge.MapPage | knowledge.QueryMap | knowledge.Rows | knowledge.UpdateMap | knowledge.Updated
    | knowledge.Rejected | knowledge.ReadHistory | knowledge.History | knowledge.SubscribeMap | knowledge.MapSubscribed
    | knowledge.MapChanged | knowledge.OntologyChanged | knowledge.RenameObject | knowledge.MergeObject | knowledge.Undo
    | knowledge.Consider | knowledge.Considered | knowledge.ReadEvents | knowledge.Events
    | reservations.Reserve | reservations.Reserved | reservations.ReservationDenied | reservations.ReservationFree
    | reservations.ReservationLost | reservations.Release | reservations.ClaimReservations
    | reservations.AssignTask | reservations.TaskAssigned
    | neighbours.ReadNeighbours | neighbours.Neighbours | neighbours.Adopt | neighbours.Adopted | neighbours.AdoptionRefused
    | neighbours.NeighbourAwaited
)  # fmt: skip
ClientBody = (
    submission.Submit | submission.SubmitOnce | submission.Submitted | submission.TaskRejected | submission.CancelTask
    | submission.Cancelling | submission.PauseTask | submission.TaskPaused
    | task_news.ReadTasks | task_news.Tasks | task_news.WatchTask | task_news.TaskNews | previews.Preview | previews.Previewed
    | records.ReadRecords | records.Records | task_news.WatchTasks | task_news.TasksNews | task_news.ReadMessages | task_news.Messages
)  # fmt: skip
OrderBody = (
    orders.ReadTemplates | orders.TemplatesPage | orders.SaveTemplate | orders.RenameTemplate | orders.RemoveTemplate | orders.TemplateKept
    | orders.FillTemplate | orders.TemplateFilled | orders.ReadOrders | orders.OrdersPage | orders.SaveOrder | orders.TurnOrder
    | orders.RemoveOrder | orders.OrderKept | orders.NoLongerKept | orders.ReadRuns | orders.RunsPage | orders.OrdersRejected
    | orders.SubscribeOrders | orders.OrdersSubscribed | orders.OrdersChanged
)  # fmt: skip
TrafficBody = (
    traffic.EnterTraffic | traffic.TrafficEntered | traffic.ReportPlace | traffic.RequestTrip | traffic.TripBegun
    | traffic.CancelTrip | traffic.TripEnded | traffic.Granted | traffic.LeaveTraffic | traffic.TrafficLeft
    | traffic.ReadTraffic | traffic.TrafficView
    | traffic.ReadRoadmap | traffic.RoadmapPage | traffic.RoadmapReplaced | traffic.PassageOpen
    | traffic.PassageClosed | traffic.EnterPassage | traffic.PassageEntered | traffic.ReportPassage | traffic.CallPassage
    | traffic.ReleasePassage
)  # fmt: skip
if TYPE_CHECKING:
    # For type checkers, `Body` is the common base class: checking a union of this size would take half of their time.
    Body = MessageBody
else:
    Body = FrpBody | DirectoryBody | KnowledgeBody | ClientBody | OrderBody | TrafficBody

REQUESTS: dict[type[Body], tuple[type[Body], ...]] = {
    directory.Publish: (directory.Published,),
    directory.Renew: (directory.Published,),
    directory.Retract: (directory.Retracted,),
    directory.Discover: (directory.Discovered,),
    directory.SubscribeServices: (directory.ServicesSubscribed,),
    directory.ReadPresence: (directory.PresenceLog,),
    knowledge.ReadOntology: (knowledge.OntologyPage,),
    knowledge.Define: (knowledge.Defined, knowledge.Rejected),
    knowledge.ReadMap: (knowledge.MapPage,),
    knowledge.QueryMap: (knowledge.Rows,),
    knowledge.UpdateMap: (knowledge.Updated, knowledge.Rejected),
    knowledge.RenameObject: (knowledge.Updated, knowledge.Rejected),
    knowledge.MergeObject: (knowledge.Updated, knowledge.Rejected),
    knowledge.Undo: (knowledge.Updated, knowledge.Rejected),
    knowledge.Consider: (knowledge.Considered,),
    knowledge.ReadHistory: (knowledge.History,),
    knowledge.ReadEvents: (knowledge.Events,),
    knowledge.SubscribeMap: (knowledge.MapSubscribed,),
    reservations.Reserve: (reservations.Reserved, reservations.ReservationDenied),
    reservations.AssignTask: (reservations.TaskAssigned,),
    neighbours.ReadNeighbours: (neighbours.Neighbours,),
    neighbours.Adopt: (neighbours.Adopted, neighbours.AdoptionRefused),
    submission.Submit: (submission.Submitted, submission.TaskRejected),
    submission.SubmitOnce: (reservations.TaskAssigned, submission.TaskRejected),
    submission.CancelTask: (submission.Cancelling,),
    submission.PauseTask: (submission.TaskPaused,),
    task_news.ReadTasks: (task_news.Tasks,),
    task_news.WatchTask: (task_news.TaskNews,),
    previews.Preview: (previews.Previewed,),
    records.ReadRecords: (records.Records,),
    task_news.WatchTasks: (task_news.TasksNews,),
    task_news.ReadMessages: (task_news.Messages,),
    orders.ReadTemplates: (orders.TemplatesPage, orders.OrdersRejected),
    orders.SaveTemplate: (orders.TemplateKept, orders.OrdersRejected),
    orders.RenameTemplate: (orders.TemplateKept, orders.OrdersRejected),
    orders.RemoveTemplate: (orders.NoLongerKept, orders.OrdersRejected),
    orders.FillTemplate: (orders.TemplateFilled, orders.OrdersRejected),
    orders.ReadOrders: (orders.OrdersPage, orders.OrdersRejected),
    orders.SaveOrder: (orders.OrderKept, orders.OrdersRejected),
    orders.TurnOrder: (orders.OrderKept, orders.OrdersRejected),
    orders.RemoveOrder: (orders.NoLongerKept, orders.OrdersRejected),
    orders.ReadRuns: (orders.RunsPage, orders.OrdersRejected),
    orders.SubscribeOrders: (orders.OrdersSubscribed,),
    traffic.EnterTraffic: (traffic.TrafficEntered,),
    traffic.ReportPlace: (traffic.TrafficEntered,),
    traffic.RequestTrip: (traffic.TripBegun,),
    traffic.LeaveTraffic: (traffic.TrafficLeft,),
    traffic.ReadTraffic: (traffic.TrafficView,),
    traffic.ReadRoadmap: (traffic.RoadmapPage,),
    traffic.EnterPassage: (traffic.PassageEntered,),
    traffic.ReportPassage: (traffic.PassageEntered,),
    frp.Query: (frp.Status,),
}
"""The requests that are always answered, with their answers; a Fault may come instead. All other messages are one-way."""

REPORTS: dict[type[Body], tuple[type[Body], ...]] = {
    frp.Arrange: (frp.Terms, frp.Refuse),
    frp.Execute: (frp.Completed, frp.Failed, frp.Stopped, frp.Refuse),
    frp.Stop: (frp.Stopped, frp.Completed, frp.Failed),
    frp.Compensate: (frp.Compensated, frp.Stranded),
}
"""The orders of a coordinator, with the reports that a participant may answer them with."""
