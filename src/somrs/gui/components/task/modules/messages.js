// The content of protocol messages in a few words.

export function said({ type, body }) {
  switch (type) {
    case "Arrange":
    case "Execute":
      return body.precondition || body.effect || "";
    case "Terms":
      return `${number(body.price)} ${body.currency}, ${Math.round(body.duration)} s`;
    case "Completed":
    case "Stopped":
    case "Compensate":
    case "Compensated":
      return body.situation ?? "";
    case "Failed":
    case "Stranded":
      return body.description || body.situation || "";
    case "Progress":
      return body.note || body.situation || `${Math.round(100 * body.fraction)} %`;
    case "Cancel":
    case "Refuse":
    case "Stop":
      return body.reason;
    case "End":
      return body.outcome;
    case "Status":
      return body.state;
    case "Fault":
      return body.text;
    default:
      return "";
  }
}

// The accessible name of a message. It begins with the text that is seen, as speech input needs it; of this, the note may be cut.
export function saidOf(message, start, seen = said(message)) {
  const parties = message.asked ? `Task Manager to ${message.service}` : `${message.service} to Task Manager`;
  const note = said(message);
  return [since(message.at - start), message.type, seen, seen === note ? "" : note, parties].filter(Boolean).join(", ");
}

export const number = (value) => String(Math.round(value * 100) / 100);

// A duration in seconds as text.
export function since(seconds) {
  if (seconds < 9.995) return `${seconds.toFixed(2)} s`;
  if (seconds < 119.95) return `${seconds.toFixed(1)} s`;
  return span(seconds);
}

export function span(seconds) {
  const whole = Math.round(Math.abs(seconds));
  if (whole < 120) return `${whole} s`;
  const two = (value) => String(value).padStart(2, "0");
  const [hours, minutes] = [Math.floor(whole / 3600), Math.floor(whole / 60) % 60];
  return hours ? `${hours}:${two(minutes)}:${two(whole % 60)}` : `${minutes}:${two(whole % 60)}`;
}

export function clock(at) {
  const date = new Date(at * 1000);
  const two = (value, digits = 2) => String(value).padStart(digits, "0");
  return `${two(date.getHours())}:${two(date.getMinutes())}:${two(date.getSeconds())}.${two(date.getMilliseconds(), 3).slice(0, 2)}`;
}
