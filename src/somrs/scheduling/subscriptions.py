"""Who follows the templates and standing orders, and the news that they get."""

from __future__ import annotations

from somrs.errors import UsageError
from somrs.kernel.component import Effects, Send
from somrs.protocol.messages.envelope import ANONYMOUS, Header, Message, message_id
from somrs.protocol.messages.leases import grant_lease
from somrs.protocol.messages.orders import OrdersChanged, OrdersSubscribed, SubscribeOrders
from somrs.scheduling.state import SchedulerState


class OrderSubscriptions:
    """The subscriptions of a Scheduler, which are in its `state`."""

    def __init__(self, state: SchedulerState) -> None:
        self._state = state

    def subscribe(self, request: SubscribeOrders, subscriber: str, now: float) -> OrdersSubscribed:
        """Begin or renew the lease of a subscriber. Raises UsageError for one without an address, or a lease that is not positive."""
        lease = grant_lease(request.lease)
        if subscriber == ANONYMOUS:
            raise UsageError("news can only be sent to a sender with an address: set the sender to an address that can be reached")
        state = self._state
        state.subscribers[subscriber] = lease_end = now + lease
        state.subscribers = {address: end for address, end in state.subscribers.items() if end > now}
        return OrdersSubscribed(until=lease_end, begun=state.started_at)

    def publish(self, *, templates: bool = False, orders: bool = False) -> Effects:
        """Tell the subscribers what has changed."""
        self._state.news_count += 1
        news = OrdersChanged(templates=templates, orders=orders)
        for subscriber in self._state.subscribers:
            yield Send(Message(header=self._header(subscriber), body=news))

    def undelivered(self, subscriber: str) -> None:
        """News did not reach a subscriber: it gets no more."""
        self._state.subscribers.pop(subscriber, None)

    def _header(self, subscriber: str) -> Header:
        # The id contains the start time, since with another file the news are counted from 1 again.
        address = self._state.address
        id = message_id(address, subscriber, "news", self._state.news_count, self._state.started_at)
        return Header(sender=address, recipient=subscriber, message_id=id)
