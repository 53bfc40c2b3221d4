// The input video as a clock: what it shows decides which frame everything else shows.

import { takeBytes } from "./data.js";

export class Footage {
  /** `onFail` is told when the browser cannot decode a video. */
  constructor(video, player, onFail) {
    this.video = video;
    this.player = player;
    this.onFail = onFail;
    this.addresses = new Map();
    this.wanted = null;
    this.watch = 0;
    video.addEventListener("seeked", () => this.catchUp());
    video.addEventListener("ended", () => { if (player.playing) player.end(); });
    video.addEventListener("error", () => { if (video.error !== null) onFail(); });
  }

  /** Show a video of the page by name; the player follows it. */
  open(name) {
    if (!this.addresses.has(name)) {
      const file = new Blob([takeBytes(name)], { type: "video/mp4" });
      this.addresses.set(name, URL.createObjectURL(file));
    }
    this.wanted = null;
    this.video.src = this.addresses.get(name);
    this.video.load();
    this.player.follow(this);
  }

  close() {
    this.video.removeAttribute("src");
    this.video.load();
    this.player.follow(null);
  }

  start() {
    this.video.playbackRate = this.player.speed;
    this.video.play().catch(() => {}); // a seek or another video came first
    this.listen();
  }

  stop() {
    this.video.pause();
  }

  /** Go to the middle of a frame; of many wishes at once the last one counts. */
  seek(frame) {
    const time = (frame + 0.5) / this.player.rate;
    if (this.video.seeking) {
      this.wanted = time;
    } else {
      this.video.currentTime = time;
    }
  }

  catchUp() {
    if (this.wanted === null) return;
    const time = this.wanted;
    this.wanted = null;
    this.video.currentTime = time;
  }

  /** Follow the frames that the video really shows. */
  listen() {
    this.watch += 1;
    const turn = this.watch;
    const { video, player } = this;
    const told = (time) => {
      if (turn !== this.watch || !player.playing || player.clock !== this) return;
      if (!video.seeking) player.show(Math.floor(time * player.rate + 0.01));
      next();
    };
    const next = () => {
      if ("requestVideoFrameCallback" in video) {
        video.requestVideoFrameCallback((_, shown) => told(shown.mediaTime));
      } else {
        requestAnimationFrame(() => told(video.currentTime));
      }
    };
    next();
  }
}
