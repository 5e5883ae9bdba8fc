"""What a broker retains is news once, and not when a newer message is known."""

from __future__ import annotations

from somrs.adapters.things.mqtt import RetainedNews

TOPIC = "lamps/1"


def test_what_is_retained_is_news_once() -> None:
    news = RetainedNews()
    assert [news.is_news(TOPIC, b"on", is_retained=True) for _ in range(2)] == [True, False]
    news.connect()
    assert not news.is_news(TOPIC, b"on", is_retained=True)
    assert news.is_news(TOPIC, b"off", is_retained=True)
    news.forget(TOPIC)
    assert news.is_news(TOPIC, b"off", is_retained=True)


def test_what_was_retained_before_is_no_news_after_a_message() -> None:
    news = RetainedNews()
    assert [news.is_news(TOPIC, b"on", is_retained=False) for _ in range(2)] == [True, True]
    assert not news.is_news(TOPIC, b"off", is_retained=True)
    news.connect()
    assert news.is_news(TOPIC, b"off", is_retained=True)
