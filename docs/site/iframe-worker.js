/**
 * Workers for pages that are opened as files, where browsers refuse them: each runs its script in a hidden frame.
 *
 * It has what the worker of the search uses: messages both ways. That of English imports no further scripts.
 */
if (location.protocol === "file:") {
  window.Worker = class FrameWorker extends EventTarget {
    constructor(url) {
      super();
      this.addEventListener("message", (event) => this.onmessage?.(event));
      this.frame = document.createElement("iframe");
      this.frame.hidden = true;
      this.frame.srcdoc = "<!doctype html>"; // such a frame shares the page's origin; another file would not
      this.started = new Promise((done) => this.frame.addEventListener("load", done, { once: true }))
        .then(() => this.start(new URL(url, document.baseURI)));
      document.body.append(this.frame);
    }

    /** Run the script; the promise is kept once it listens. */
    start(url) {
      const inside = this.frame.contentWindow;
      inside.postMessage = (data) => { // in a worker it speaks to the page; a window's own speaks to itself
        const copy = structuredClone(data);
        setTimeout(() => this.dispatchEvent(new MessageEvent("message", { data: copy })));
      };
      const script = inside.document.createElement("script");
      script.src = url;
      inside.document.head.append(script);
      return new Promise((done) => script.addEventListener("load", () => done(inside)));
    }

    postMessage(data) {
      const copy = structuredClone(data);
      this.started.then((inside) => inside.dispatchEvent(new MessageEvent("message", { data: copy })));
    }

    terminate() {
      this.frame.remove();
    }
  };
}
