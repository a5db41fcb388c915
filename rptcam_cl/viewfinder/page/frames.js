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
    if (before && before.header.frame > header.frame) {
      bitmap.close();
      this.acknowledge(header);
      return;
    }
    if (before) {
      before.bitmap.close();
      this.acknowledge(before.header);
    }
    this.ready.set(key, { header, bitmap });
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
