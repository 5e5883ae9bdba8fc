// A switch for alerts, and the alerts: two tones, a vibration, and a notice of the browser while the page is hidden. Browsers allow tones
// only after a touch of the page, and notices only on addresses that they trust. Nothing of this needs another server.

const TONES = [660, 880]; // Hz
const TONE_TIME = 0.18; // s
const VIBRATION = [200, 100, 200]; // ms

export default {
  template: `
    <button type="button" class="somrs-alert" :aria-pressed="on" @click="turn">
      <i class="q-icon notranslate material-icons" aria-hidden="true">{{ on ? 'notifications_active' : 'notifications_off' }}</i>
      <span>{{ on ? 'Alerts on' : 'Alerts off' }}</span>
    </button>`,
  data() {
    return { on: localStorage.getItem("somrs-alerts") === "on" };
  },
  mounted() {
    this.allowSound = () => this.on && this.prepareSound();
    document.addEventListener("pointerdown", this.allowSound);
  },
  beforeUnmount() {
    document.removeEventListener("pointerdown", this.allowSound);
  },
  methods: {
    turn() {
      this.on = !this.on;
      localStorage.setItem("somrs-alerts", this.on ? "on" : "off");
      if (!this.on) return;
      this.prepareSound();
      if (window.Notification?.permission === "default") window.Notification.requestPermission();
      this.announce("");
    },
    prepareSound() {
      if (!window.AudioContext) return;
      this.sound ??= new window.AudioContext();
      if (this.sound.state === "suspended") this.sound.resume();
    },
    announce(text) {
      if (!this.on) return;
      window.navigator.vibrate?.(VIBRATION);
      if (this.sound) TONES.forEach((frequency, index) => this.play(frequency, index * TONE_TIME));
      if (text && document.hidden && window.Notification?.permission === "granted") this.notify(text);
    },
    play(frequency, delay) {
      const tone = this.sound.createOscillator();
      tone.frequency.value = frequency;
      tone.connect(this.sound.destination);
      tone.start(this.sound.currentTime + delay);
      tone.stop(this.sound.currentTime + delay + TONE_TIME);
    },
    notify(text) {
      try {
        const notice = new window.Notification(text, { tag: "somrs" });
        notice.onclick = () => window.focus();
      } catch {
        // Chrome on Android shows notices only from service workers, which need an address that it trusts.
      }
    },
  },
};
