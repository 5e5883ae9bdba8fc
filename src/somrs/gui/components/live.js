// News from `/api/live`; a lost connection is restored automatically.

const PAUSES = [300, 600, 1200, 2500]; // milliseconds before each attempt to reconnect; the last one repeats

// Subscribe to topics. `open` is called whenever the connection opens, also after a loss: news may have been missed.
export function follow(topics, { news, open, lost }) {
  let socket = null;
  let timer = null;
  let attempt = 0;
  let closed = false;
  const connect = () => {
    socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/api/live`);
    socket.onopen = () => {
      attempt = 0;
      socket.send(JSON.stringify({ follow: topics }));
      open?.();
    };
    socket.onmessage = (event) => news(JSON.parse(event.data));
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
