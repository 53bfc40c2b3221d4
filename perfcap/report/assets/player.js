// Which frame is shown, and the clock that moves on from it.

/** Sends `frame` when another frame is shown, and `state` when play, speed or repeat change. */
export class Player extends EventTarget {
  /** `opening` is shown first; what plays starts at the beginning all the same. */
  constructor(frames, rate, opening = 0) {
    super();
    this.frames = frames;
    this.rate = rate;
    this.frame = opening;
    this.untouched = true;
    this.playing = false;
    this.speed = 1;
    this.loop = true;
    this.clock = new Timer(this);
  }

  /** Let something else, such as a video, tell the time; null for the page's own clock. */
  follow(clock) {
    const { playing } = this;
    if (playing) this.clock.stop();
    this.clock = clock ?? new Timer(this);
    this.clock.seek(this.frame);
    if (playing) this.clock.start();
  }

  /** Go to a frame. */
  seek(frame) {
    this.untouched = false;
    this.show(frame);
    this.clock.seek(this.frame);
  }

  /** Show a frame that the clock has come to. */
  show(frame) {
    const next = Math.min(this.frames - 1, Math.max(0, Math.round(frame)));
    if (next === this.frame) return;
    this.frame = next;
    this.dispatchEvent(new Event("frame"));
  }

  play() {
    if (this.playing) return;
    if (this.untouched || this.frame === this.frames - 1) this.seek(0);
    this.playing = true;
    this.clock.start();
    this.dispatchEvent(new Event("state"));
  }

  pause() {
    if (!this.playing) return;
    this.playing = false;
    this.clock.stop();
    this.clock.seek(this.frame);
    this.dispatchEvent(new Event("state"));
  }

  toggle() {
    if (this.playing) this.pause();
    else this.play();
  }

  /** The clock has come to the end. */
  end() {
    if (this.loop) {
      this.seek(0);
      this.clock.start();
    } else {
      this.show(this.frames - 1);
      this.pause();
    }
  }

  setSpeed(speed) {
    this.speed = speed;
    if (this.playing) this.clock.start();
    this.dispatchEvent(new Event("state"));
  }

  setLoop(loop) {
    this.loop = loop;
    this.dispatchEvent(new Event("state"));
  }
}

/** The page's own clock. */
class Timer {
  constructor(player) {
    this.player = player;
    this.request = 0;
    this.from = 0;
    this.since = 0;
  }

  start() {
    cancelAnimationFrame(this.request);
    this.from = this.player.frame;
    this.since = performance.now();
    this.tick();
  }

  tick() {
    this.request = requestAnimationFrame((now) => {
      const { rate, speed, frames } = this.player;
      const frame = Math.floor(this.from + 1e-3 * Math.max(0, now - this.since) * rate * speed);
      if (frame >= frames) {
        this.player.end();
        return;
      }
      this.player.show(frame);
      this.tick();
    });
  }

  stop() {
    cancelAnimationFrame(this.request);
  }

  seek(frame) {
    this.from = frame;
    this.since = performance.now();
  }
}
