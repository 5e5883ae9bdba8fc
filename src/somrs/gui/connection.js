// What the user does before the page is connected to the server must reach it in the order in which it was done. NiceGUI keeps each event
// in a timer of its own until it finds `did_handshake` true, and sends them as the timers come. Socket.IO keeps what it is given in order,
// and sends it when the connection is open. That is late enough if the request for the connection itself was the handshake.

let isConnected = false;

Object.defineProperty(window, "did_handshake", {
  get: () => isConnected || Boolean(window.socket?.io.opts.query.implicit_handshake),
  set(value) { isConnected = value; },
});

// Where the session has ended, there is no connection. The page is loaded again, and so shows the form to sign in.
const CHECK_PAUSE = 1000;

async function reloadIfSignedOut() {
  if (window.socket?.disconnected) {
    const answer = await fetch("/api/access/me", { cache: "no-store" }).catch(() => null);
    if (answer?.status === 401) location.reload();
  }
  setTimeout(reloadIfSignedOut, CHECK_PAUSE);
}

reloadIfSignedOut();
