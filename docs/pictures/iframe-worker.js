// Search in a site that is opened from a folder: browsers refuse workers there, so the script of a worker runs in a frame.
// Its name contains "iframe-worker", by which the plugin `offline` knows that it needs none from elsewhere.
if (location.protocol === "file:") {
  window.Worker = class extends EventTarget {
    constructor(url) {
      super();
      const frame = document.createElement("iframe");
      frame.hidden = true;
      document.body.append(frame);
      const inside = frame.contentWindow;
      inside.document.open();
      inside.document.close();
      const send = inside.postMessage.bind(inside);
      inside.postMessage = data => this.dispatchEvent(new MessageEvent("message", {data}));
      const script = inside.document.createElement("script");
      const ready = new Promise(done => { script.onload = done; });
      script.src = url;
      inside.document.body.append(script);
      this.postMessage = data => ready.then(() => send(data, "*"));
    }
  };
}
