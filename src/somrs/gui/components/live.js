// News as they happen, from `/api/live`; a connection that is lost is made again by itself.

const PAUSES = [300, 600, 1200, 2500]; // milliseconds before each attempt to connect again; the last one goes on

// Hear of the topics. `open` is called whenever the connection is there, also after it was lost: then read what may have been missed.
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
