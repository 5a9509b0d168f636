// Files of unfinished uploads, in the browser's own database: a reload goes on without asking for the file again. Where the browser
// keeps nothing (a private window, a full disk), the upload itself works all the same.
const DATABASE = "lampwright";
const STORE = "uploads";

function open() {
  return new Promise((resolve, reject) => {
    const request = indexedDB.open(DATABASE, 1);
    request.onupgradeneeded = () => request.result.createObjectStore(STORE, { keyPath: "url" });
    request.onsuccess = () => resolve(request.result);
    request.onerror = () => reject(request.error);
  });
}

async function within(mode, action) {
  try {
    const database = await open();
    return await new Promise((resolve, reject) => {
      const transaction = database.transaction(STORE, mode);
      const request = action(transaction.objectStore(STORE));
      transaction.oncomplete = () => { database.close(); resolve(request.result); };
      transaction.onabort = transaction.onerror = () => { database.close(); reject(transaction.error); };
    });
  } catch (error) {
    console.info("the browser keeps no uploads:", error?.message);
    return undefined;
  }
}

export const keep = (upload) => within("readwrite", (store) => store.put(upload));
export const release = (url) => within("readwrite", (store) => store.delete(url));
/** Whether an upload is still unfinished: another tab may have seen to it. */
export const isKept = async (url) => Boolean(await within("readonly", (store) => store.getKey(url)));
export const kept = async () => (await within("readonly", (store) => store.getAll())) ?? [];
