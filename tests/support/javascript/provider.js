// An OpenID Connect provider for tests: node provider.js SETTINGS, where SETTINGS is JSON with `client`, `secret`, `returns` (the addresses that
// browsers may be sent back to) and `people` (the claims of each, by login). It prints its issuer. PUT /test/fault makes its next tokens wrong,
// /test/people says something else of people, /test/returns sends browsers back elsewhere, and /test/keys gives it new keys.

import { createServer } from "node:http";
import process from "node:process";
import { text } from "node:stream/consumers";

import { SignJWT, decodeJwt, exportJWK, generateKeyPair } from "jose";
import Provider from "oidc-provider";

const settings = JSON.parse(process.argv[2]);
let fault = "";
let keys = 0;
let current, earlier;

const faults = {
  issuer: (claims) => ({ ...claims, iss: "https://evil.example" }),
  audience: (claims) => ({ ...claims, aud: "another-client" }),
  nonce: (claims) => ({ ...claims, nonce: "of another sign-in" }),
  expired: (claims) => ({ ...claims, iat: claims.iat - 7200, exp: claims.iat - 3600 }),
  early: (claims) => ({ ...claims, iat: claims.iat + 7200, exp: claims.iat + 9000 }),
  forged: (claims) => claims,
  key: (claims) => claims,
  unsigned: (claims) => claims,
  withdrawn: (claims) => claims,
};

const base64 = (content) => Buffer.from(JSON.stringify(content)).toString("base64url");

const wrongToken = async (idToken) => {
  const claims = faults[fault](decodeJwt(idToken));
  if (fault === "unsigned") return `${base64({ alg: "none" })}.${base64(claims)}.`;
  const signer = fault === "withdrawn" ? earlier : current;
  const key = ["forged", "key"].includes(fault) ? (await generateKeyPair("RS256")).privateKey : signer.key;
  return new SignJWT(claims).setProtectedHeader({ alg: "RS256", kid: fault === "key" ? "nobody's" : signer.id }).sign(key);
};

const newProvider = async (issuer) => {
  const { privateKey } = await generateKeyPair("RS256", { extractable: true });
  keys += 1;
  const id = `key-${keys}`;
  const provider = new Provider(issuer, {
    clients: [
      {
        client_id: settings.client,
        client_secret: settings.secret,
        redirect_uris: settings.returns.map((url) => `${url}/sign-in/return`),
        post_logout_redirect_uris: settings.returns.map((url) => `${url}/sign-in`),
      },
    ],
    jwks: { keys: [{ ...(await exportJWK(privateKey)), kid: id, alg: "RS256", use: "sig" }] },
    cookies: { keys: ["a key of tests"] },
    claims: { openid: ["sub"], profile: ["name", "preferred_username", "groups"], email: ["email"] },
    findAccount: (_context, login) => ({ accountId: login, claims: () => ({ sub: login, ...settings.people[login] }) }),
    // Nobody is asked whether this client may know who one is.
    loadExistingGrant: async ({ oidc }) => {
      const grant = new oidc.provider.Grant({ clientId: oidc.client.clientId, accountId: oidc.session.accountId });
      grant.addOIDCScope("openid profile email");
      await grant.save();
      return grant;
    },
  });
  provider.use(async (context, next) => {
    await next();
    if (fault && context.path === "/token" && context.body?.id_token) context.body.id_token = await wrongToken(context.body.id_token);
  });
  return { key: privateKey, id, serve: provider.callback() };
};

const server = createServer(async (request, response) => {
  if (request.url === "/test/fault") {
    fault = await text(request);
    response.end();
  } else if (request.url === "/test/people") {
    settings.people = JSON.parse(await text(request));
    response.end();
  } else if (request.url === "/test/returns") {
    settings.returns = JSON.parse(await text(request));
    current = await newProvider(settings.issuer);
    response.end();
  } else if (request.url === "/test/keys") {
    earlier = current;
    current = await newProvider(settings.issuer);
    response.end();
  } else {
    current.serve(request, response);
  }
});
server.listen(0, "127.0.0.1", async () => {
  settings.issuer = `http://127.0.0.1:${server.address().port}`;
  current = await newProvider(settings.issuer);
  process.stdout.write(`${settings.issuer}\n`);
});
