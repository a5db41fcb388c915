/** The page: the viewfinder over a WebSocket to the server that it came from. */

import { Viewfinder } from "./app.js";
import { keepToken, Socket, takeToken } from "./socket.js";

const address = `${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/ws`;
const socket = new Socket(address, takeToken());
const finder = new Viewfinder(document.getElementById("viewfinder"), socket, document);
finder.link.on("hello", ({ token, scene }) => {
  if (token) keepToken(socket, token);
  document.title = `${scene} · viewfinder`;
});
socket.open();
