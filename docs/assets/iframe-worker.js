"use strict";
// Browsers start no worker from a file. On pages that are opened from a folder, the worker of the search runs in a hidden
// frame. The frame has the same `addEventListener` and `postMessage` as a worker.
if (location.protocol === "file:") {
  window.Worker = class extends EventTarget {
    constructor(script) {
      super();
      const frame = document.createElement("iframe");
      frame.hidden = true;
      this.waiting = [];
      frame.addEventListener("load", () => {
        const inside = frame.contentWindow, tag = frame.contentDocument.createElement("script");
        inside.postMessage = (data) => this.dispatchEvent(new MessageEvent("message", { data }));
        tag.src = script;
        tag.addEventListener("load", () => {
          this.send = (data) => inside.dispatchEvent(new MessageEvent("message", { data }));
          this.waiting.forEach(this.send);
        });
        frame.contentDocument.head.append(tag);
      }, { once: true });
      document.body.append(frame);
    }
    postMessage(data) {
      this.send ? this.send(data) : this.waiting.push(data);
    }
  };
}
