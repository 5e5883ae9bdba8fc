// Passkeys (Web Authentication Level 3): adding one to an account, and signing in with one. Used by the page to sign in and by People and access.

const CAN = Boolean(window.PublicKeyCredential?.parseCreationOptionsFromJSON);

async function post(path, content) {
  const headers = { "Content-Type": "application/json" };
  const answer = await fetch(path, { method: "POST", headers, body: JSON.stringify(content) });
  const report = await answer.json();
  if (!answer.ok) throw new Error(report.problem);
  return report;
}

function problemOf(error) {
  if (error.name === "NotAllowedError") return "No passkey was used: that was cancelled, or there is none for this address here.";
  if (error.name === "InvalidStateError") return "This device has a passkey of yours already.";
  return error.message;
}

async function addPasskey(name) {
  if (!CAN) throw new Error("This browser has no passkeys; a newer one has.");
  const publicKey = PublicKeyCredential.parseCreationOptionsFromJSON(await post("/passkeys/options", {}));
  const credential = await navigator.credentials.create({ publicKey });
  await post("/passkeys", { name, credential: credential.toJSON() });
}

async function signIn(next) {
  const publicKey = PublicKeyCredential.parseRequestOptionsFromJSON(await post("/sign-in/passkey/options", {}));
  const credential = await navigator.credentials.get({ publicKey });
  return (await post("/sign-in/passkey", { next, credential: credential.toJSON() })).next;
}

// A page calls this where somebody adds a passkey: in an element with a field for its name, to which it sends `added`, with the problem, if
// there is one.
window.addPasskey = async (element) => {
  let problem = "";
  try {
    await addPasskey(element.querySelector("input").value);
  } catch (error) {
    problem = problemOf(error);
  }
  element.dispatchEvent(new CustomEvent("added", { detail: problem }));
};

function showProblem(button, text) {
  document.querySelector("[role=alert]")?.remove();
  const alert = document.createElement("p");
  alert.className = "somrs-problem";
  alert.role = "alert";
  alert.textContent = text;
  button.before(alert);
}

const button = document.querySelector(".somrs-sign-in-passkey");
if (button && CAN) {
  button.hidden = false;
  button.parentElement.hidden = false;
  button.addEventListener("click", async () => {
    button.disabled = true;
    try {
      location.assign(await signIn(button.dataset.next));
    } catch (error) {
      showProblem(button, problemOf(error));
      button.disabled = false;
    }
  });
}
