/* The search of the site is a Worker, which browsers do not start from file:. There, this replacement runs the worker's
   script in a hidden frame, with the same interface: postMessage, and the event "message". */
if (location.protocol === "file:") {
  window.Worker = class extends EventTarget {
    constructor(address) {
      super();
      const frame = document.createElement("iframe");
      frame.hidden = true;
      frame.title = "search";
      document.body.append(frame);
      const worker = frame.contentWindow;
      const inside = frame.contentDocument;
      worker.postMessage = (data) => this.answer(data);
      worker.importScripts = async (...scripts) => {
        for (const script of scripts) await this.load(inside, script);
      };
      this.worker = worker;
      this.ready = this.load(inside, new URL(address, location.href).href);
    }

    load(inside, address) {
      return new Promise((done, failed) => {
        const script = inside.createElement("script");
        script.src = address;
        script.onload = done;
        script.onerror = () => failed(new Error(`cannot load ${address}`));
        inside.head.append(script);
      });
    }

    postMessage(data) {
      this.ready.then(() => this.worker.dispatchEvent(new MessageEvent("message", { data })));
    }

    answer(data) {
      const event = new MessageEvent("message", { data });
      this.dispatchEvent(event);
      if (this.onmessage) this.onmessage(event);
    }
  };
}
