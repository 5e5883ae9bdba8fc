// News from `/api/live`; a lost connection is restored automatically.

const PAUSES = [300, 600, 1200, 2500]; // milliseconds before each attempt to reconnect; the last one repeats

// Subscribe to topics. `open` is called whenever they are followed, also after a loss: what is read then is not older than the first news.
export function follow(topics, { news, open, lost }) {
  let socket = null;
  let timer = null;
  let attempt = 0;
  let closed = false;
  const connect = () => {
    socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/api/live`);
    socket.onopen = () => socket.send(JSON.stringify({ follow: topics, confirm: 1 }));
    socket.onmessage = (event) => {
      const message = JSON.parse(event.data);
      if (message.confirmed === undefined) return news(message);
      attempt = 0;
      open?.();
    };
    socket.onclose = () => {
      if (closed) return;
      lost?.();
      timer = setTimeout(connect, PAUSES[Math.min(attempt++, PAUSES.length - 1)]);
    };
  };
  connect();
  return () => {
    closed = true;
    clearTimeout(timer);
    socket.close();
  };
}
