// SPDX-License-Identifier: Apache-2.0
// Search runs in a worker, which browsers do not start for pages that are opened as files: there a
// hidden frame takes its place.
if (location.protocol === "file:") {
  window.Worker = class extends EventTarget {
    constructor(script) {
      super();
      this.frame = document.createElement("iframe");
      this.frame.hidden = true;
      document.body.append(this.frame);
      const inside = this.frame.contentWindow;
      inside.postMessage = (data) => setTimeout(() => this.receive(data));
      this.loaded = new Promise((resolve) => {
        const element = inside.document.createElement("script");
        element.src = new URL(script, location.href).href;
        element.onload = () => resolve(inside);
        inside.document.head.append(element);
      });
    }

    receive(data) {
      const event = new MessageEvent("message", { data });
      this.dispatchEvent(event);
      this.onmessage?.(event);
    }

    async postMessage(data) {
      const inside = await this.loaded;
      // What is sent is an object of the frame there, as it would be one of the worker.
      const copied = inside.structuredClone(data);
      inside.dispatchEvent(new inside.MessageEvent("message", { data: copied }));
    }

    terminate() {
      this.frame.remove();
    }
  };
}
