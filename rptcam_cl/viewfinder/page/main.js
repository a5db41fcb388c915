/** The page: the viewfinder over a WebSocket to the server that it came from. */

import { Viewfinder } from "./app.js";
import { keepToken, Socket, takeToken } from "./socket.js";

const address = `${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/ws`;
const socket = new Socket(address, takeToken());
let title = document.title;
const finder = new Viewfinder(document.getElementById("viewfinder"), socket, document);
finder.link.on("hello", ({ token, scene }) => {
  if (token) keepToken(socket, token);
  title = `${scene} · viewfinder`;
});
finder.link.on("link", () => { document.title = finder.isDead ? `⚠ no connection · ${title}` : title; });
socket.open();
