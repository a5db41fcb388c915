/** The way to the server: a WebSocket that comes back by itself, and says hello with the token of the page's address. */

const KEPT = "rptcam-token";
const FIRST_WAIT = 500; // [ms], doubled at each failure
const LONGEST_WAIT = 4000;

const REFUSALS = {
  4400: "The server did not understand this page. Reload it.",
  4401: "The server does not know this page's token. Open the address that rptcam view printed.",
  4408: "The server waited too long for this page's greeting. Reload it.",
  4429: "Four pages show this scene already. Close one, then reload this one.",
};

/** The token from the address, which is cleaned of it, or from before a reload. */
export function takeToken() {
  const given = location.hash.slice(1);
  if (given) {
    sessionStorage.setItem(KEPT, given);
    history.replaceState(null, "", location.pathname);
  }
  return sessionStorage.getItem(KEPT) ?? "";
}

/** Keep the token that the server gave for reloads and reconnections: the one of the address is good for one greeting. */
export function keepToken(socket, token) {
  socket.token = token;
  sessionStorage.setItem(KEPT, token);
}

/** A transport: `send(text)`, and `onmessage(data)`, `onstate(state, words)` to be set by who uses it. */
export class Socket {
  constructor(address, token) {
    this.address = address;
    this.token = token;
    this.wait = FIRST_WAIT;
    this.ended = false;
    this.onmessage = () => {};
    this.onstate = () => {};
  }

  open() {
    this.onstate("connecting", "Connecting");
    const socket = new WebSocket(this.address);
    socket.binaryType = "arraybuffer";
    socket.onopen = () => socket.send(JSON.stringify({ type: "hello", token: this.token, version: 1 }));
    socket.onmessage = (event) => {
      this.wait = FIRST_WAIT;
      this.onmessage(event.data);
    };
    socket.onclose = (event) => this.closed(event);
    this.socket = socket;
  }

  closed(event) {
    if (this.ended) return;
    if (event.code in REFUSALS) {
      this.onstate("refused", REFUSALS[event.code]);
      return;
    }
    this.lost("The server is gone. Trying again.");
  }

  /** Begin anew with a server that does not answer. */
  silent() {
    const { socket } = this;
    socket.onmessage = socket.onclose = () => {};
    socket.close();
    this.lost("The server does not answer. Trying again.");
  }

  lost(words) {
    this.onstate("lost", words);
    setTimeout(() => this.ended || this.open(), this.wait);
    this.wait = Math.min(2 * this.wait, LONGEST_WAIT);
  }

  send(text) {
    if (this.socket?.readyState === WebSocket.OPEN) this.socket.send(text);
  }

  close() {
    this.ended = true;
    this.socket?.close();
  }
}
