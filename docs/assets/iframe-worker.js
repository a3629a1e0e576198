/* Browsers start no worker for a page that was opened from a folder. There the script of the search runs in a hidden
   frame instead, behind the same two calls: postMessage and the event "message". Nothing is fetched from elsewhere. */
if (location.protocol === "file:") {
  window.IFrameWorker = window.Worker = class extends EventTarget {
    constructor(url) {
      super();
      this.waiting = [];
      this.frame = document.createElement("iframe");
      this.frame.hidden = true;
      const script = document.createElement("script");
      script.src = new URL(url, document.baseURI).href;
      this.frame.srcdoc =
        "<script>self.postMessage = data => parent.postMessage({ofFrame: true, data}, '*')</script>" + script.outerHTML;
      window.addEventListener("message", event => {
        if (event.source === this.frame.contentWindow && event.data && event.data.ofFrame)
          this.dispatchEvent(new MessageEvent("message", { data: event.data.data }));
      });
      this.frame.addEventListener("load", () => {
        const kept = this.waiting;
        this.waiting = null;
        kept.forEach(data => this.postMessage(data));
      });
      const attach = () => document.body.append(this.frame);
      document.body ? attach() : document.addEventListener("DOMContentLoaded", attach);
    }
    postMessage(data) {
      if (this.waiting) this.waiting.push(data);
      else this.frame.contentWindow.dispatchEvent(new MessageEvent("message", { data }));
    }
  };
}
