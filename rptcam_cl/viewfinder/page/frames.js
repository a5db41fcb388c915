/** Frames as they come: decoded, drawn with the next picture of the screen, acknowledged. A newer one replaces an older one. */

export function keyOf(header) {
  return `${header.slot}/${header.kind}/${header.overlay ?? ""}`;
}

export class Frames {
  /** `draw(header, bitmap)` is called before the screen is painted. */
  constructor(link, draw) {
    this.link = link;
    this.draw = draw;
    this.ready = new Map();
    this.newest = new Map(); // numbers of those that were ready last
    link.on("hello", () => this.newest.clear());
    link.on("frame", (header, bytes) => this.receive(header, bytes));
  }

  async receive(header, bytes) {
    let bitmap = null;
    try {
      bitmap = await createImageBitmap(new Blob([bytes], { type: header.media }));
    } catch {
      this.acknowledge(header); // a picture that cannot be decoded must not stop the others
      return;
    }
    const key = keyOf(header);
    const before = this.ready.get(key);
    if (this.newest.get(key) > header.frame) { // it took longer to decode
      bitmap.close();
      this.acknowledge(header);
      return;
    }
    if (before) {
      before.bitmap.close();
      this.acknowledge(before.header);
    }
    this.ready.set(key, { header, bitmap });
    this.newest.set(key, header.frame);
    if (!this.due) this.due = requestAnimationFrame(() => this.paint());
  }

  paint() {
    this.due = null;
    const ready = [...this.ready.values()];
    this.ready.clear();
    for (const { header, bitmap } of ready) {
      this.draw(header, bitmap);
      bitmap.close();
      this.acknowledge(header);
      this.link.emit("painted", header);
    }
  }

  acknowledge(header) {
    this.link.transport.send(JSON.stringify({ type: "ack", frame: header.frame }));
  }
}
